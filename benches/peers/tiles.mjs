#!/usr/bin/env node
// Holds Boresight's tiles beside others' tools: meshoptimizer's own (npm, WebAssembly), and CesiumJS in a headless Chromium.
//
//     node benches/peers/tiles.mjs [--program PATH] [TILESET,WHERE...]
//
// It simplifies the mesh of `cargo bench -- simplification`, and has CesiumJS choose tiles for cameras that look at the middle of
// each tileset, which `boresight tiles inspect` is asked about too. WHERE is x,y,z in the tileset's own frame [m], or
// @latitude,longitude,height. npm packages go into a folder of their own in ~/.cache/boresight; Chromium is Debian's.
import { execFileSync } from 'node:child_process';
import fs from 'node:fs';
import http from 'node:http';
import { createRequire } from 'node:module';
import os from 'node:os';
import path from 'node:path';

const home = path.join(process.env.XDG_CACHE_HOME ?? path.join(os.homedir(), '.cache'), 'boresight/peers-npm');
const wanted = ['meshoptimizer@1.3.0', 'cesium@1.145.0', 'playwright-core'];
if (!wanted.every((name) => fs.existsSync(path.join(home, 'node_modules', name.split('@')[0])))) {
  fs.mkdirSync(home, { recursive: true });
  execFileSync('npm', ['install', '--silent', '--prefix', home, ...wanted], { stdio: 'inherit' });
}
const own = createRequire(path.join(home, 'package.json'));

async function simplification() {
  const { MeshoptSimplifier } = await import(own.resolve('meshoptimizer'));
  await MeshoptSimplifier.ready;
  const side = 708;
  const places = new Float32Array(3 * side * side);
  for (let k = 0; k < side * side; k++) {
    const [x, y] = [k % side, Math.floor(k / side)];
    const z = 20 * Math.sin(0.02 * x) * Math.cos(0.017 * y) + 2 * Math.sin(0.3 * x) * Math.sin(0.21 * y);
    places.set([2 * x, 2 * y, z], 3 * k);
  }
  const indices = new Uint32Array(6 * (side - 1) * (side - 1));
  let n = 0;
  for (let y = 0; y + 1 < side; y++)
    for (let x = 0; x + 1 < side; x++) {
      const k = y * side + x;
      indices.set([k, k + 1, k + side + 1, k, k + side + 1, k + side], n);
      n += 6;
    }
  const rates = [];
  let kept, error;
  for (let turn = 0; turn < 5; turn++) {
    const begun = performance.now();
    [kept, error] = MeshoptSimplifier.simplify(indices, places, 3, 3 * Math.floor(n / 12), 0.1, ['LockBorder']);
    rates.push(n / 3 / (performance.now() - begun) / 1e3);
  }
  rates.sort((a, b) => a - b);
  const metres = error * MeshoptSimplifier.getScale(places, 3);
  console.log(`meshoptimizer (npm, WebAssembly): ${rates[2].toFixed(2)} million triangles/s, ` +
    `${((100 * kept.length) / n).toFixed(1)} % kept, error ${metres.toFixed(3)} m (median of 5)`);
}

// Serves folders by the first part of the path.
function serve(folders) {
  const kinds = { '.js': 'text/javascript', '.json': 'application/json', '.html': 'text/html', '.wasm': 'application/wasm' };
  const server = http.createServer((request, response) => {
    const [, first, ...rest] = decodeURIComponent(request.url.split('?')[0]).split('/');
    const file = folders[first] && path.join(folders[first], rest.join('/'));
    if (first === '') {
      response.setHeader('content-type', 'text/html');
      return response.end('<style>.cesium-widget, canvas { width: 100%; height: 100% }</style>' +
        '<script src="/cesium/Build/Cesium/Cesium.js"></script><div id="view"></div>');
    }
    if (!file || !fs.existsSync(file) || fs.statSync(file).isDirectory()) return response.writeHead(404).end();
    response.setHeader('content-type', kinds[path.extname(file)] ?? 'application/octet-stream');
    fs.createReadStream(file).pipe(response);
  });
  return new Promise((done) => server.listen(0, '127.0.0.1', () => done(server)));
}

// In the page: what CesiumJS draws of a tileset from a place, and how fast.
async function choose([url, where, onEarth, size]) {
  const Cesium = window.Cesium;
  const view = document.getElementById('view');
  view.style.cssText = `width: ${size[0]}px; height: ${size[1]}px`;
  const widget = new Cesium.CesiumWidget(view, {
    globe: false, skyBox: false, skyAtmosphere: false, baseLayer: false, useDefaultRenderLoop: false,
    contextOptions: { webgl: { antialias: false } },
  });
  widget.resolutionScale = 1;
  widget.resize();
  const { scene } = widget;
  // The rule of the specification alone: no skipped levels, no detail held back away from the middle or while moving.
  const tileset = await Cesium.Cesium3DTileset.fromUrl(url, {
    maximumScreenSpaceError: 16, dynamicScreenSpaceError: false, foveatedScreenSpaceError: false,
    cullRequestsWhileMoving: false, cullWithChildrenBounds: false, skipLevelOfDetail: false, preloadWhenHidden: true,
  });
  scene.primitives.add(tileset);
  const eye = onEarth ? Cesium.Cartesian3.fromDegrees(where[1], where[0], where[2]) : new Cesium.Cartesian3(...where);
  const middle = Cesium.Cartesian3.clone(tileset.root.boundingVolume.boundingVolume.center);
  const direction = Cesium.Cartesian3.normalize(Cesium.Cartesian3.subtract(middle, eye, new Cesium.Cartesian3()), new Cesium.Cartesian3());
  const top = onEarth ? Cesium.Ellipsoid.WGS84.geodeticSurfaceNormal(eye) : Cesium.Cartesian3.UNIT_Z;
  const right = Cesium.Cartesian3.normalize(Cesium.Cartesian3.cross(direction, top, new Cesium.Cartesian3()), new Cesium.Cartesian3());
  const up = Cesium.Cartesian3.cross(right, direction, new Cesium.Cartesian3());
  const vertical = Cesium.Math.toRadians(60);
  const aspect = size[0] / size[1];
  // Cesium's fov is that of the longer side.
  scene.camera.frustum = new Cesium.PerspectiveFrustum({
    fov: aspect > 1 ? 2 * Math.atan(Math.tan(vertical / 2) * aspect) : vertical, aspectRatio: aspect, near: 0.1, far: 1e6,
  });
  scene.camera.setView({ destination: eye, orientation: { direction, up } });
  const frame = () => { scene.initializeFrame(); scene.render(); };
  // All is there when nothing has been asked for in many frames.
  for (let k = 0, quiet = 0; k < 2000 && quiet < 40; k++) {
    frame();
    quiet = tileset.tilesLoaded ? quiet + 1 : 0;
    await new Promise((done) => setTimeout(done, 20));
  }
  const begun = performance.now();
  for (let k = 0; k < 5; k++) frame();
  const pixel = new Uint8Array(4);
  scene.context._gl.readPixels(0, 0, 1, 1, scene.context._gl.RGBA, scene.context._gl.UNSIGNED_BYTE, pixel);
  const milliseconds = (performance.now() - begun) / 5;
  const { selected, numberOfTrianglesSelected } = tileset.statistics;
  const levels = {};
  for (const tile of tileset._selectedTiles) {
    const level = tile.implicitCoordinates?.level ?? tile._depth;
    levels[level] = (levels[level] ?? 0) + 1;
  }
  widget.destroy();
  return { tiles: selected, triangles: numberOfTrianglesSelected, levels, milliseconds };
}

function ours(program, folder, where, size) {
  const at = where.startsWith('@') ? ['--at', where.slice(1)] : [`--at-xyz=${where}`];
  const said = execFileSync(program, ['tiles', 'inspect', folder, ...at, '--size', size.join('x')]).toString();
  const [, tiles, triangles] = said.match(/draws\s+([\d,]+) tiles?, ([\d,]+) triangles/).map((text) => Number(text.replaceAll(',', '')));
  const levels = {};
  for (const [, count, level] of said.matchAll(/(\d+) of level (\d+)/g)) levels[level] = Number(count);
  return { tiles, triangles, levels };
}

async function selection(program, asked) {
  const size = [1280, 800];
  const folders = { cesium: path.join(home, 'node_modules/cesium') };
  const tilesets = asked.map((text, k) => {
    const [folder, ...where] = text.split(',');
    folders[`set${k}`] = path.resolve(folder);
    return { folder, url: `set${k}/tileset.json`, where: where.join(',') };
  });
  const server = await serve(folders);
  const base = `http://127.0.0.1:${server.address().port}/`;
  const { chromium } = own('playwright-core');
  const browser = await chromium.launch({
    executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
    args: ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist', '--disable-background-networking'],
  });
  let differ = 0;
  for (const { folder, url, where } of tilesets) {
    const page = await browser.newPage();
    page.on('pageerror', (error) => console.error(String(error)));
    await page.goto(base);
    const numbers = where.replace('@', '').split(',').map(Number);
    const theirs = await page.evaluate(choose, [base + url, numbers, where.startsWith('@'), size]);
    const mine = ours(program, folder, where, size);
    const same = JSON.stringify(mine.levels) === JSON.stringify(theirs.levels) && mine.triangles === theirs.triangles;
    differ += same ? 0 : 1;
    const words = ({ tiles, triangles, levels }) => `${tiles} tiles, ${triangles} triangles, by level ${JSON.stringify(levels)}`;
    console.log(`${folder} from ${where}, ${size.join(' × ')} px: ${same ? 'the same' : 'NOT the same'}\n` +
      `  Boresight  ${words(mine)}\n  CesiumJS   ${words(theirs)}; ${theirs.milliseconds.toFixed(0)} ms a frame (SwiftShader)`);
    await page.close();
  }
  await browser.close();
  server.close();
  return differ;
}

const [, , ...words] = process.argv;
const flag = words.indexOf('--program');
const program = flag < 0 ? 'boresight' : words.splice(flag, 2)[1];
await simplification();
process.exitCode = words.length > 0 && (await selection(program, words)) > 0 ? 1 : 0;
