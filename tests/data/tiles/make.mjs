// Makes the small files beside it, which the tests of `src/tiles/content` decode: encoders that are not the program's own.
//
//   npm install @gltf-transform/core@4.5.1 @gltf-transform/extensions@4.5.1 @gltf-transform/functions@4.5.1 \
//     draco3dgltf@1.5.7 draco3d@1.5.7 meshoptimizer@1.3.0 ktx2-encoder@0.6.0
//   node make.mjs
//
// The mesh is a grid of 8 × 8 squares over 0..1 in x and y with z = x·y/2, normals and texture coordinates (x, y).
// The cloud has the grid's points, in colours (x, y, 0.25) of 255, each of feature row · 9 + column modulo 4.
// The picture has 16 × 16 pixels: red grows with the column, green with the row, blue is 64, alpha 255.

import { writeFileSync } from "node:fs";
import { Document, NodeIO } from "@gltf-transform/core";
import { ALL_EXTENSIONS } from "@gltf-transform/extensions";
import { draco, meshopt, quantize } from "@gltf-transform/functions";
import draco3d from "draco3dgltf";
import draco3dPoints from "draco3d";
import { MeshoptDecoder, MeshoptEncoder } from "meshoptimizer";
import { encodeToKTX2 } from "ktx2-encoder";

const N = 8;

function grid() {
  const document = new Document();
  const buffer = document.createBuffer();
  const positions = [], normals = [], uv = [], indices = [];
  for (let j = 0; j <= N; j++) {
    for (let i = 0; i <= N; i++) {
      const [x, y] = [i / N, j / N];
      positions.push(x, y, (x * y) / 2);
      const length = Math.hypot(y / 2, x / 2, 1);
      normals.push(-y / 2 / length, -x / 2 / length, 1 / length);
      uv.push(x, y);
    }
  }
  for (let j = 0; j < N; j++) {
    for (let i = 0; i < N; i++) {
      const a = j * (N + 1) + i;
      indices.push(a, a + 1, a + N + 2, a, a + N + 2, a + N + 1);
    }
  }
  const accessor = (type, array) => document.createAccessor().setType(type).setArray(array).setBuffer(buffer);
  const primitive = document
    .createPrimitive()
    .setIndices(accessor("SCALAR", new Uint16Array(indices)))
    .setAttribute("POSITION", accessor("VEC3", new Float32Array(positions)))
    .setAttribute("NORMAL", accessor("VEC3", new Float32Array(normals)))
    .setAttribute("TEXCOORD_0", accessor("VEC2", new Float32Array(uv)));
  const node = document.createNode().setMesh(document.createMesh().addPrimitive(primitive));
  document.createScene().addChild(node);
  return document;
}

await MeshoptEncoder.ready;
const io = new NodeIO().registerExtensions(ALL_EXTENSIONS).registerDependencies({
  "draco3d.encoder": await draco3d.createEncoderModule(),
  "draco3d.decoder": await draco3d.createDecoderModule(),
  "meshopt.encoder": MeshoptEncoder,
  "meshopt.decoder": MeshoptDecoder,
});
for (const [name, transform] of [
  ["draco-edgebreaker", draco({ method: "edgebreaker" })],
  ["draco-sequential", draco({ method: "sequential" })],
  ["meshopt", meshopt({ encoder: MeshoptEncoder, level: "high" })],
  ["quantized", quantize()],
]) {
  const document = grid();
  await document.transform(transform);
  writeFileSync(`${name}.glb`, await io.writeBinary(document));
}

// A cloud as pnts, by both of Draco's methods: its entries' places in the table do not count.
const { Encoder, PointCloudBuilder, PointCloud, DracoInt8Array, ...D } = await draco3dPoints.createEncoderModule();
const padded = (bytes, fill) => Buffer.concat([bytes, Buffer.alloc(-bytes.length & 7, fill)]);
for (const [name, method] of [
  ["draco-cloud-sequential", 0],
  ["draco-cloud-kd-tree", 1],
]) {
  const [positions, colors, ids] = [[], [], []];
  for (let k = 0; k < (N + 1) ** 2; k++) {
    const [x, y] = [(k % (N + 1)) / N, Math.floor(k / (N + 1)) / N];
    positions.push(x, y, (x * y) / 2);
    colors.push(Math.round(255 * x), Math.round(255 * y), 64);
    ids.push(k % 4);
  }
  const count = ids.length;
  const [encoder, builder, cloud, out] = [new Encoder(), new PointCloudBuilder(), new PointCloud(), new DracoInt8Array()];
  const POSITION = builder.AddFloatAttribute(cloud, D.POSITION, count, 3, new Float32Array(positions));
  const RGB = builder.AddUInt8Attribute(cloud, D.COLOR, count, 3, new Uint8Array(colors));
  const BATCH_ID = builder.AddUInt16Attribute(cloud, D.GENERIC, count, 1, new Uint16Array(ids));
  encoder.SetEncodingMethod(method);
  encoder.SetAttributeQuantization(D.POSITION, 14);
  const length = encoder.EncodePointCloudToDracoBuffer(cloud, false, out);
  const data = padded(Buffer.from(Array.from({ length }, (_, i) => out.GetValue(i) & 255)), 0);
  const draco = { properties: { POSITION, RGB, BATCH_ID }, byteOffset: 0, byteLength: length };
  const table = padded(Buffer.from(JSON.stringify({
    POINTS_LENGTH: count, BATCH_LENGTH: 4, RTC_CENTER: [10, 20, 30],
    POSITION: { byteOffset: 0 }, RGB: { byteOffset: 0 }, BATCH_ID: { byteOffset: 0, componentType: "UNSIGNED_SHORT" },
    extensions: { "3DTILES_draco_point_compression": draco },
  })), " ");
  const batch = padded(Buffer.from(JSON.stringify({ name: ["a", "b", "c", "d"] })), " ");
  const header = Buffer.alloc(32);
  header.write("pnts");
  const whole = 28 + table.length + data.length + batch.length;
  [1, whole, table.length, data.length, batch.length, 0].forEach((n, i) => header.writeUInt32LE(n, 4 + 4 * i));
  writeFileSync(`${name}.pnts`, Buffer.concat([header.subarray(0, 28), table, data, batch]));
}

const side = 16;
const data = new Uint8Array(4 * side * side);
for (let row = 0; row < side; row++) {
  for (let column = 0; column < side; column++) {
    data.set([column * 17, row * 17, 64, 255], 4 * (row * side + column));
  }
}
const imageDecoder = async () => ({ data, width: side, height: side });
for (const [name, options] of [
  ["etc1s", { isUASTC: false, qualityLevel: 255 }],
  ["uastc", { isUASTC: true, needSupercompression: false }],
  ["uastc-zstd", { isUASTC: true, needSupercompression: true }],
]) {
  const file = await encodeToKTX2(new Uint8Array(1), { imageDecoder, generateMipmap: true, ...options });
  writeFileSync(`${name}.ktx2`, file);
}
