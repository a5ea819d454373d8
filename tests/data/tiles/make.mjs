// Makes the small files beside it, which the tests of `src/tiles/content` decode: encoders that are not the program's own.
//
//   npm install @gltf-transform/core@4.5.1 @gltf-transform/extensions@4.5.1 @gltf-transform/functions@4.5.1 \
//     draco3dgltf@1.5.7 meshoptimizer@1.3.0 ktx2-encoder@0.6.0
//   node make.mjs
//
// The mesh is a grid of 8 × 8 squares over 0..1 in x and y with z = x·y/2, normals and texture coordinates (x, y).
// The picture has 16 × 16 pixels: red grows with the column, green with the row, blue is 64, alpha 255.

import { writeFileSync } from "node:fs";
import { Document, NodeIO } from "@gltf-transform/core";
import { ALL_EXTENSIONS } from "@gltf-transform/extensions";
import { draco, meshopt, quantize } from "@gltf-transform/functions";
import draco3d from "draco3dgltf";
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
