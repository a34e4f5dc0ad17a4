// What pages draw of an explanation: its object by WebGL, and its outlines. vig_app.report.drawing and contents make the data:
// faces, vertices and colours of a mesh; of each pose how it differs from that, and its camera; where the picture of
// distances to the outlines lies.
let mesh = null, faces, parts, fitted, loaded = null;
const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer;
const numbersOf = (packed, length) => packed ? Float32Array.from(new Int8Array(bytes(packed.numbers)), level => level * packed.step) : new Float32Array(length);

// Unit normals: the sum of the adjacent faces', each as long as its area.
const normalsOf = place => {
  const total = new Float32Array(place.length);
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [0, 1, 2].map(corner => 3 * faces[f + corner]);
    const [ux, uy, uz, vx, vy, vz] = [0, 1, 2].map(k => place[b + k] - place[a + k]).concat([0, 1, 2].map(k => place[c + k] - place[a + k]));
    const area = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const corner of [a, b, c]) for (let k = 0; k < 3; k++) total[corner + k] += area[k];
  }
  for (let v = 0; v < total.length; v += 3) {
    const length = Math.hypot(total[v], total[v + 1], total[v + 2]) || 1;
    for (let k = 0; k < 3; k++) total[v + k] /= length;
  }
  return total;
};
const atCorners = (size, value) => { const out = new Float32Array(faces.length * size); for (let i = 0; i < out.length; i++) out[i] = value(Math.floor(i / size), i % size); return out; };

const glCanvas = document.createElement("canvas");
const gl = glCanvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
let draw = null, paint = () => {}; // a pose on glCanvas by a matrix to clip space, width x height; own colours of parts or one; the light turned
if (gl) {
  const program = gl.createProgram();
  const compile = (kind, source) => { const shader = gl.createShader(kind); gl.shaderSource(shader, source); gl.compileShader(shader); gl.attachShader(program, shader); };
  compile(gl.VERTEX_SHADER, `
    attribute vec3 place, normal, colour; attribute vec2 surface; uniform mat4 clip; uniform vec3 albedo; uniform float own, light, sh[9];
    varying vec3 shade;
    float irradiance(vec3 n) {
      return 0.282095 * sh[0] + 0.488603 * 0.666667 * (sh[1] * n.y + sh[2] * n.z + sh[3] * n.x)
        + 0.25 * (1.092548 * (sh[4] * n.x * n.y + sh[5] * n.y * n.z + sh[7] * n.x * n.z)
        + 0.315392 * sh[6] * (3.0 * n.z * n.z - 1.0) + 0.546274 * sh[8] * (n.x * n.x - n.y * n.y));
    }
    void main() {
      gl_Position = clip * vec4(place, 1.0);
      float c = cos(light), s = sin(light), still = irradiance(normal);
      float e = irradiance(vec3(c * normal.x + s * normal.y, c * normal.y - s * normal.x, normal.z));
      // Self-shadowing is known of the fit's light; of another it is taken to be in proportion.
      float shadow = surface.x * (light == 0.0 ? 1.0 : clamp(e / max(still, 0.05), 0.0, 2.0));
      shade = mix(albedo, colour, own) * surface.y * max(e + shadow, 0.0);
    }`);
  compile(gl.FRAGMENT_SHADER, `precision mediump float; varying vec3 shade;
    void main() { vec3 c = clamp(shade, 0.0, 1.0); gl_FragColor = vec4(mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)), 1.0); }`);
  gl.linkProgram(program); gl.useProgram(program); gl.enable(gl.DEPTH_TEST);
  const buffers = {}, at = name => gl.getUniformLocation(program, name);
  const fill = (name, size, values) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[name] ??= gl.createBuffer()); gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    const place = gl.getAttribLocation(program, name); gl.enableVertexAttribArray(place); gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
  };
  paint = () => fill("colour", 3, atCorners(3, (corner, k) => mesh.colours[parts[faces[corner - corner % 3]]][k]));
  draw = (pose, clip, width, height, own, light) => {
    if (loaded !== pose) {
      const moved = numbersOf(pose.vertices, fitted.length), place = fitted.map((value, at) => value + moved[at]);
      const normal = normalsOf(place), shadow = numbersOf(pose.shadow, parts.length);
      fill("place", 3, atCorners(3, (corner, k) => place[3 * faces[corner] + k]));
      fill("normal", 3, atCorners(3, (corner, k) => normal[3 * faces[corner] + k]));
      fill("surface", 2, atCorners(2, (corner, k) => k ? mesh.reflectance?.[parts[faces[corner]]] ?? 1 : shadow[faces[corner]]));
      gl.uniform3fv(at("albedo"), pose.albedo); gl.uniform1fv(at("sh"), pose.light);
      loaded = pose;
    }
    if (glCanvas.width !== width || glCanvas.height !== height) { glCanvas.width = width; glCanvas.height = height; }
    gl.viewport(0, 0, width, height); gl.clearColor(0, 0, 0, 0); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(at("clip"), false, clip); gl.uniform1f(at("own"), own); gl.uniform1f(at("light"), light);
    gl.drawArrays(gl.TRIANGLES, 0, faces.length);
  };
}
const load = next => {
  mesh = next; loaded = null;
  faces = new (mesh.bytes === 2 ? Uint16Array : Uint32Array)(bytes(mesh.faces)); parts = new Uint16Array(bytes(mesh.parts));
  fitted = Float32Array.from(new Uint16Array(bytes(mesh.vertices)), (level, at) => mesh.low[at % 3] + level * mesh.steps[at % 3]);
  paint();
};

const BORDER = [20, 20, 20], OUTLINE = [255, 210, 0], HIDDEN = [235, 40, 120];
const pixelsOf = image => {
  const canvas = Object.assign(document.createElement("canvas"), { width: image.naturalWidth, height: image.naturalHeight }), context = canvas.getContext("2d");
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, image.naturalWidth, image.naturalHeight).data;
};
// Outlines, and where the object is hidden, by the picture of distances to the outlines, on the contexts of two canvases.
const drawOutlines = (drawn, whole, maps, { size, line, step, map: [[a, b, c], [d, e, f], [g, h, i]] }) => {
  const { width, height } = drawn.canvas, levels = pixelsOf(maps), border = Math.max(1, line / 2), share = distance => Math.min(1, Math.max(0, 0.5 + distance));
  const lines = drawn.createImageData(width, height), hidden = drawn.createImageData(width, height);
  const distance = (first, across, down) => {
    const second = first + 4 * size, upper = levels[first] + across * (levels[first + 4] - levels[first]);
    return step * (upper + down * (levels[second] + across * (levels[second + 4] - levels[second]) - upper) - 128);
  };
  for (let y = 0, pixel = 0; y < height; y++) for (let x = 0; x < width; x++, pixel += 4) {
    const X = x + 0.5, Y = y + 0.5, w = g * X + h * Y + i, u = (a * X + b * Y + c) / w - 0.5, v = (d * X + e * Y + f) / w - 0.5;
    const column = Math.floor(u), row = Math.floor(v);
    if (!(column >= 0 && row >= 0 && column < size - 1 && row < size - 1)) continue;
    const first = 4 * (row * size + column), outer = distance(first, u - column, v - row);
    if (outer > 2 * border + line + 1) continue;
    const isHidden = outer < 0.5 ? share(-outer) * share(distance(first + 4 * size * size, u - column, v - row)) : 0;
    const middle = Math.abs(outer - border - line / 2), dark = share(line / 2 + border - middle), bright = share(line / 2 - middle);
    hidden.data[pixel + 3] = 255 * isHidden;
    const alpha = 1 - (1 - isHidden / 2) * (1 - dark) * (1 - bright);
    for (let k = 0; alpha && k < 3; k++) {
      const tinted = HIDDEN[k] * isHidden / 2, bordered = tinted + dark * (BORDER[k] - tinted);
      lines.data[pixel + k] = (bordered + bright * (OUTLINE[k] - bordered)) / alpha;
    }
    lines.data[pixel + 3] = 255 * alpha;
  }
  drawn.putImageData(lines, 0, 0); whole?.putImageData(hidden, 0, 0);
};

// The object in front of the photo's window, which is the first of the panels.
const drawPose = (canvas, pose, panels, place) => {
  const context = canvas.getContext("2d"), { width, height } = canvas;
  context.drawImage(panels, ...place, 0, 0, width, height);
  if (draw) { draw(pose, pose.clip, width, height, 0, 0); context.drawImage(glCanvas, 0, 0); }
};
// The object in 3-D.
const model = get("model");
let pose = null, azimuth, elevation, light = 0, turnsLight = false;
const drawModel = () => {
  if (!draw || !pose) return;
  const sa = Math.sin(azimuth), ca = Math.cos(azimuth), se = Math.sin(elevation), ce = Math.cos(elevation);
  const right = [ca, sa, 0], up = [-se * sa, se * ca, ce], back = [ce * sa, -ce * ca, se], far = 6, zoom = 1.6 * far;
  // Columns of a perspective projection of the eye at `far` sizes; depth between far - 2 and far + 2.
  const near = far - 2, end = far + 2, a = (end + near) / (end - near), b = -2 * end * near / (end - near);
  const clip = [], last = [0, 0, a * far + b, far];
  for (let i = 0; i < 3; i++) {
    const column = [zoom * right[i], zoom * up[i], -a * back[i], -back[i]].map(number => number / mesh.size);
    clip.push(...column);
    for (let k = 0; k < 4; k++) last[k] -= column[k] * mesh.target[i];
  }
  draw(pose, [...clip, ...last], model.width, model.height, 1, light);
  const context = model.getContext("2d");
  context.fillStyle = "#8a9099"; context.fillRect(0, 0, model.width, model.height); context.drawImage(glCanvas, 0, 0);
};
const move = (x, y) => {
  if (turnsLight) light += x; else { azimuth -= x; elevation = Math.max(-1.5, Math.min(1.5, elevation + y)); }
  drawModel();
};
const show = other => { pose = other; ({ azimuth, elevation } = pose); drawModel(); };
model.addEventListener("pointerdown", event => model.setPointerCapture(event.pointerId));
model.addEventListener("pointermove", event => { if (event.buttons) move(event.movementX / 120, event.movementY / 120); });
model.addEventListener("keydown", event => {
  const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
  if (step) { move(...step); event.preventDefault(); }
});
