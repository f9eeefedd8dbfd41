"use strict";
// The surfaces of the page's captures in 3-D: a height field each, turned by mouse, touch and
// keys. Without WebGL 2 the figure stays as the page made it: a still picture.
(() => {
const figure = document.querySelector(".viewer");
if (!figure) return;
const canvas = figure.querySelector("canvas"), form = figure.querySelector("form");
const status = figure.querySelector(".status"), legend = figure.querySelector(".legend");
const scales = JSON.parse(document.getElementById("scales").textContent);
const HOME = {yaw: 0.45, pitch: 0.22, zoom: 1};
// a surface tears where it is steeper than JUMP
const FIELD = Math.tan(14 * Math.PI / 180), LIFT_MM = 0.8, JUMP = 6;
let gl, program, scene, drawn = [], camera = {...HOME}, waiting = false;

const VERTEX = `#version 300 es
in vec3 place, normal, colour;
uniform mat4 eye, lens;
uniform float lift, size;
out vec3 n, c;
void main() {
  vec4 e = eye * vec4(place, 1.0), nearer = lens * (e + vec4(0, 0, lift, 0));
  gl_Position = lens * e;
  gl_Position.z = nearer.z / nearer.w * gl_Position.w;
  gl_PointSize = size / gl_Position.w;
  n = mat3(eye) * normal;
  c = colour;
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 n, c;
uniform float opacity;
out vec4 pixel;
void main() {
  vec3 m = dot(n, n) > 0.0 ? normalize(n) : vec3(0, 0, 1);
  m *= m.z < 0.0 ? -1.0 : 1.0;
  float key = max(dot(m, normalize(vec3(-0.45, 0.55, 0.70))), 0.0),
        fill = max(dot(m, normalize(vec3(0.8, -0.2, 0.5))), 0.0);
  pixel = vec4(c * (0.36 + 0.66 * key + 0.16 * fill) * opacity, opacity);
}`;

function compiled() {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  ["place", "normal", "colour"].forEach((name, i) => gl.bindAttribLocation(made, i, name));
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return made;
}

const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
const rgb = hex => [1, 3, 5].map(i => parseInt(hex.slice(i, i + 2), 16) / 255);
const NO_REFERENCE = [0.5, 0.5, 0.5];  // the colour with the number 0
const PALETTE = {depth: scales.depth.map(rgb), error: [NO_REFERENCE, ...scales.error.map(rgb)]};

// Vertices in mm, triangles between neighbours, and the vertices that no triangle holds.
function mesh(surface) {
  const [rows, columns] = surface.shape, seen = bytes(surface.seen),
        z = new Uint16Array(bytes(surface.z).buffer);
  const number = new Int32Array(rows * columns).fill(-1), place = new Float32Array(3 * z.length);
  const step = (ends, count) => count > 1 ? (ends[1] - ends[0]) / (count - 1) : 0;
  const dx = step(surface.x_mm, columns), dy = step(surface.y_mm, rows);
  for (let i = 0, count = 0; i < rows * columns; i++) {
    if (!(seen[i >> 3] >> (7 - i % 8) & 1)) continue;
    place.set([surface.x_mm[0] + dx * (i % columns), surface.y_mm[0] + dy * Math.floor(i / columns),
               scene.low_mm + scene.step_mm * z[count]], 3 * count);
    number[i] = count++;
  }
  const triangles = [], normal = new Float32Array(place.length), held = new Uint8Array(z.length);
  const depth = i => place[3 * i + 2], steep = JUMP * Math.max(Math.abs(dx), Math.abs(dy));
  const corner = (a, b, c) => {
    if (a < 0 || b < 0 || c < 0) return;
    const deep = [a, b, c].map(depth);
    if (Math.max(...deep) - Math.min(...deep) > steep) return;
    triangles.push(a, b, c);
    const u = [0, 1, 2].map(k => place[3 * b + k] - place[3 * a + k]),
          v = [0, 1, 2].map(k => place[3 * c + k] - place[3 * a + k]);
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    for (const i of [a, b, c]) {
      held[i] = 1;
      for (let k = 0; k < 3; k++) normal[3 * i + k] += n[k];
    }
  };
  for (let row = 0; row + 1 < rows; row++) for (let column = 0; column + 1 < columns; column++) {
    const i = row * columns + column,
          [a, b, c, d] = [i, i + 1, i + columns + 1, i + columns].map(k => number[k]);
    if (b < 0 || d < 0) { corner(a, b, c); corner(a, c, d); }
    else { corner(a, b, d); corner(b, c, d); }
  }
  const lone = [...held.keys()].filter(i => !held[i]);
  return {place, normal, triangles: new Uint32Array(triangles), lone: new Uint32Array(lone),
          dx: Math.abs(dx) || 1};
}

function colours(surface, place, by, against) {
  const colour = new Float32Array(place.length), error = surface.errors[against];
  const numbers = error && bytes(error.colours), last = PALETTE.depth.length - 1;
  const [near, far] = scene.depth_mm;
  for (let i = 0; i < place.length / 3; i++) {
    let c = scales.skin;
    if (by === "depth") {
      c = PALETTE.depth[
        Math.round(last * Math.min(Math.max((place[3 * i + 2] - near) / (far - near), 0), 1))];
    } else if (numbers) {
      c = PALETTE.error[numbers[i]];
    }
    colour.set(c, 3 * i);
  }
  return colour;
}

function upload(surface, isReference, choice) {
  const made = mesh(surface), array = gl.createVertexArray();
  gl.bindVertexArray(array);
  const arrays = [made.place, made.normal,
                  colours(surface, made.place, choice.colour, choice.against)];
  const buffers = arrays.map((data, i) => {
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(i);
    gl.vertexAttribPointer(i, 3, gl.FLOAT, false, 0, 0);
    return buffer;
  });
  const order = new Uint32Array([...made.triangles, ...made.lone]), index = gl.createBuffer();
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, index);
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, order, gl.STATIC_DRAW);
  gl.bindVertexArray(null);
  return {array, buffers: [...buffers, index], triangles: made.triangles.length,
          lone: made.lone.length, dx: made.dx, isReference};
}

function choose() {
  const choice = Object.fromEntries(new FormData(form));
  const text = document.getElementById(choice.capture).textContent;
  if (!scene || scene.id !== choice.capture) {
    scene = {...JSON.parse(text), id: choice.capture};
    scene.middle = middle();
  }
  if (!scene.references.includes(choice.against)) choice.against = scene.references[0];
  for (const old of drawn) {
    gl.deleteVertexArray(old.array);
    old.buffers.forEach(b => gl.deleteBuffer(b));
  }
  const shown = scene.surfaces.filter(
    s => s.name === choice.method || (choice.reference && s.name === choice.against));
  drawn = shown.map(s => upload(s, s.name === choice.against, choice));
  const method = shown.find(s => s.name === choice.method),
        note = method && method.errors[choice.against];
  status.textContent = `${scene.capture}: ` + (
    method ? `${method.title}, ${method.pixels} pixels observed${note ? ", " + note.note : ""}`
    : "no radar surface shown");
  key(choice.colour);
  redraw();
}

// The box of the first surface: its middle and how much of it must be seen.
function middle() {
  const {x_mm, y_mm} = scene.surfaces[0], [near, far] = scene.depth_mm;
  const half = Math.max(Math.abs(x_mm[1] - x_mm[0]), Math.abs(y_mm[1] - y_mm[0]), 20) / 2;
  return {at: [(x_mm[0] + x_mm[1]) / 2, (y_mm[0] + y_mm[1]) / 2, (near + far) / 2], half};
}

function key(by) {
  const ticks = by === "depth"
    ? [0, 0.25, 0.5, 0.75, 1].map(at => [
        (scene.depth_mm[0] + at * (scene.depth_mm[1] - scene.depth_mm[0])).toFixed(0), at])
    : scales.ticks.map(([mm, at]) => [(mm > 0 ? "+" : "") + String(mm).replace("-", "−"), at]);
  legend.querySelector(".what").textContent = by === "depth" ? "depth z in mm"
    : "signed error z − z_ref in mm: − before the reference, + behind it; grey: no reference";
  legend.querySelector(".bar").style.background =
    `linear-gradient(to right, ${scales[by].join(",")})`;
  legend.querySelector(".ticks").replaceChildren(...ticks.map(([text, at]) => {
    const tick = document.createElement("span");
    tick.textContent = text;
    tick.style.left = `${100 * at}%`;
    return tick;
  }));
}

// Matrices by columns. The eye looks along +z with y up, so that x grows to the left, as seen
// from the array.
function matrices() {
  const [cy, sy, cp, sp] = [Math.cos(camera.yaw), Math.sin(camera.yaw),
                            Math.cos(camera.pitch), Math.sin(camera.pitch)];
  const rows = [[-cy, 0, -sy], [-sp * sy, cp, sp * cy], [cp * sy, sp, -cp * cy]],
        {at, half} = scene.middle;
  const wide = canvas.width / canvas.height,
        far = 1.12 * half / FIELD / Math.min(wide, 1) / camera.zoom;
  const shift = rows.map(
    (row, i) => -row.reduce((sum, r, k) => sum + r * at[k], 0) - (i === 2 ? far : 0));
  const eye = [0, 1, 2].flatMap(k => [rows[0][k], rows[1][k], rows[2][k], 0]).concat(shift, 1);
  const [n, f] = [Math.max(far - 3 * half, far / 50), far + 3 * half];
  const lens = [1 / FIELD / wide, 0, 0, 0, 0, 1 / FIELD, 0, 0,
                0, 0, (n + f) / (n - f), -1, 0, 0, 2 * n * f / (n - f), 0];
  return {eye, lens};
}

function draw() {
  waiting = false;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight].map(
    size => Math.round(size * devicePixelRatio));
  if (!width || !height) return;
  if (canvas.width !== width || canvas.height !== height)
    [canvas.width, canvas.height] = [width, height];
  gl.viewport(0, 0, width, height);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  const {eye, lens} = matrices(), at = name => gl.getUniformLocation(program, name);
  gl.uniformMatrix4fv(at("eye"), false, eye);
  gl.uniformMatrix4fv(at("lens"), false, lens);
  const pass = (surface, compare, opacity) => {
    gl.depthFunc(compare);
    gl.uniform1f(at("opacity"), opacity);
    // small errors do not sink into the reference
    gl.uniform1f(at("lift"), surface.isReference ? 0 : LIFT_MM);
    gl.uniform1f(at("size"), 1.2 * surface.dx * height / 2 / FIELD);
    gl.bindVertexArray(surface.array);
    gl.drawElements(gl.TRIANGLES, surface.triangles, gl.UNSIGNED_INT, 0);
    gl.drawElements(gl.POINTS, surface.lone, gl.UNSIGNED_INT, 4 * surface.triangles);
  };
  const references = drawn.filter(s => s.isReference), radar = drawn.filter(s => !s.isReference);
  references.forEach(s => pass(s, gl.LEQUAL, 1));
  gl.depthMask(false);
  // what the reference hides shows through
  if (references.length) radar.forEach(s => pass(s, gl.GREATER, 0.7));
  gl.depthMask(true);
  radar.forEach(s => pass(s, gl.LEQUAL, 1));
}

function redraw() { if (!waiting) { waiting = true; requestAnimationFrame(draw); } }

function turn(yaw, pitch, zoom = 1) {
  camera.yaw += yaw;
  camera.pitch = Math.min(Math.max(camera.pitch + pitch, -1.5), 1.5);
  camera.zoom = Math.min(Math.max(camera.zoom * zoom, 0.4), 12);
  redraw();
}

function home() { camera = {...HOME}; redraw(); }

function listen() {
  const fingers = new Map(), apart = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  canvas.addEventListener("pointerdown", e => {
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    canvas.setPointerCapture(e.pointerId);
  });
  for (const end of ["pointerup", "pointercancel"])
    canvas.addEventListener(end, e => fingers.delete(e.pointerId));
  canvas.addEventListener("pointermove", e => {
    if (!fingers.has(e.pointerId)) return;
    const [x, y] = fingers.get(e.pointerId), before = fingers.size === 2 ? apart() : 0;
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    if (before) turn(0, 0, apart() / before);
    else turn((e.clientX - x) / 150, (e.clientY - y) / 150);
  });
  canvas.addEventListener("wheel", e => {
    if (document.activeElement !== canvas) return;  // the page scrolls on until the view is chosen
    e.preventDefault();
    turn(0, 0, Math.exp(-e.deltaY / 500));
  }, {passive: false});
  const KEYS = {ArrowLeft: [-0.12, 0], ArrowRight: [0.12, 0], ArrowUp: [0, -0.12],
                ArrowDown: [0, 0.12], "+": [0, 0, 1.15], "=": [0, 0, 1.15],
                "-": [0, 0, 1 / 1.15]};
  canvas.addEventListener("keydown", e => {
    if (e.ctrlKey || e.metaKey || e.altKey) return;
    if (e.key === "Home") home(); else if (KEYS[e.key]) turn(...KEYS[e.key]); else return;
    e.preventDefault();
  });
  form.addEventListener("change", choose);
  form.addEventListener("submit", e => e.preventDefault());
  figure.querySelector("button").addEventListener("click", home);
  canvas.addEventListener("webglcontextlost", () => figure.classList.remove("live"));
  new ResizeObserver(redraw).observe(canvas);
}

try {
  gl = canvas.getContext("webgl2", {antialias: true, preserveDrawingBuffer: true});
  if (!gl) return;
  program = compiled();
  gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  figure.classList.add("live");
  choose();
  listen();
} catch (error) {
  figure.classList.remove("live");
  throw error;
}
})();
