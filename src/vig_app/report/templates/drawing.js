// Objects by WebGL on `glCanvas`, and outlines by the distances to them; meshes and poses as report/drawing.py packs them.
const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer;
const numbersOf = (packed, length) => packed ? Float32Array.from(new Int8Array(bytes(packed.numbers)), level => level * packed.step) : new Float32Array(length);

// A mesh with its faces, parts and the fit's vertices as numbers.
const opened = mesh => ({
  ...mesh, faces: new (mesh.bytes === 2 ? Uint16Array : Uint32Array)(bytes(mesh.faces)), parts: new Uint16Array(bytes(mesh.parts)),
  fitted: Float32Array.from(new Uint16Array(bytes(mesh.vertices)), (level, at) => mesh.low[at % 3] + level * mesh.steps[at % 3]),
});

// Unit normals: the sum of the adjacent faces', each as long as its area.
const normalsOf = (faces, place) => {
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

const glCanvas = document.createElement("canvas");
const gl = glCanvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
let draw = null, forget = () => {}; // a pose of a mesh by a matrix to clip space, width x height; own colours of parts or one; the light turned
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
  const at = name => gl.getUniformLocation(program, name), loaded = new Map(); // pose: its arrays on the device
  const arraysOf = (mesh, pose) => {
    const { faces, parts, fitted } = mesh, moved = numbersOf(pose.vertices, fitted.length), place = fitted.map((value, at) => value + moved[at]);
    const normal = normalsOf(faces, place), shadow = numbersOf(pose.shadow, parts.length);
    const atCorners = (size, value) => {
      const out = new Float32Array(faces.length * size), buffer = gl.createBuffer();
      for (let i = 0; i < out.length; i++) out[i] = value(faces[Math.floor(i / size)], i % size, Math.floor(i / size));
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.bufferData(gl.ARRAY_BUFFER, out, gl.STATIC_DRAW);
      return { buffer, size };
    };
    return {
      place: atCorners(3, (vertex, k) => place[3 * vertex + k]), normal: atCorners(3, (vertex, k) => normal[3 * vertex + k]),
      surface: atCorners(2, (vertex, k) => k ? mesh.reflectance?.[parts[vertex]] ?? 1 : shadow[vertex]),
      colour: atCorners(3, (vertex, k, corner) => mesh.colours[parts[faces[corner - corner % 3]]][k]),
    };
  };
  forget = () => { // frees what drawn poses hold on the device
    for (const arrays of loaded.values()) for (const { buffer } of Object.values(arrays)) gl.deleteBuffer(buffer);
    loaded.clear();
  };
  draw = (mesh, pose, clip, width, height, own, light) => {
    if (!loaded.has(pose)) loaded.set(pose, arraysOf(mesh, pose));
    for (const [name, { buffer, size }] of Object.entries(loaded.get(pose))) {
      const place = gl.getAttribLocation(program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.enableVertexAttribArray(place); gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
    }
    if (glCanvas.width !== width || glCanvas.height !== height) { glCanvas.width = width; glCanvas.height = height; }
    gl.viewport(0, 0, width, height); gl.clearColor(0, 0, 0, 0); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniform3fv(at("albedo"), pose.albedo); gl.uniform1fv(at("sh"), pose.light);
    gl.uniformMatrix4fv(at("clip"), false, clip); gl.uniform1f(at("own"), own); gl.uniform1f(at("light"), light);
    gl.drawArrays(gl.TRIANGLES, 0, mesh.faces.length);
  };
}

// By columns, a perspective projection of the eye at six sizes of a mesh; depth between two sizes before and behind it.
const turned = (mesh, azimuth, elevation) => {
  const sa = Math.sin(azimuth), ca = Math.cos(azimuth), se = Math.sin(elevation), ce = Math.cos(elevation);
  const right = [ca, sa, 0], up = [-se * sa, se * ca, ce], back = [ce * sa, -ce * ca, se], far = 6, zoom = 1.6 * far;
  const near = far - 2, end = far + 2, a = (end + near) / (end - near), b = -2 * end * near / (end - near);
  const clip = [], last = [0, 0, a * far + b, far];
  for (let i = 0; i < 3; i++) {
    const column = [zoom * right[i], zoom * up[i], -a * back[i], -back[i]].map(number => number / mesh.size);
    clip.push(...column);
    for (let k = 0; k < 4; k++) last[k] -= column[k] * mesh.target[i];
  }
  return [...clip, ...last];
};

const pixelsOf = image => {
  const canvas = Object.assign(document.createElement("canvas"), { width: image.naturalWidth, height: image.naturalHeight }), context = canvas.getContext("2d");
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, image.naturalWidth, image.naturalHeight).data;
};

// The outline on a photo of width x height, hidden pixels in pink, and where the object is hidden, as opacity.
const BORDER = [20, 20, 20], OUTLINE = [255, 210, 0], HIDDEN = [235, 40, 120];
const outlined = (maps, { size, line, step, map: [[a, b, c], [d, e, f], [g, h, i]] }, width, height) => {
  const levels = pixelsOf(maps), border = Math.max(1, line / 2), share = distance => Math.min(1, Math.max(0, 0.5 + distance));
  const lines = new ImageData(width, height), hidden = new ImageData(width, height);
  for (let y = 0, pixel = 0; y < height; y++) for (let x = 0; x < width; x++, pixel += 4) {
    const X = x + 0.5, Y = y + 0.5, w = g * X + h * Y + i, u = (a * X + b * Y + c) / w - 0.5, v = (d * X + e * Y + f) / w - 0.5;
    const column = Math.floor(u), row = Math.floor(v);
    if (!(column >= 0 && row >= 0 && column < size - 1 && row < size - 1)) continue;
    const across = u - column, down = v - row;
    const distance = which => {
      const first = 4 * ((row + which * size) * size + column), second = first + 4 * size;
      const upper = levels[first] + across * (levels[first + 4] - levels[first]), lower = levels[second] + across * (levels[second + 4] - levels[second]);
      return step * (upper + down * (lower - upper) - 128);
    };
    const outer = distance(0);
    if (outer > 2 * border + line + 1) continue;
    const middle = Math.abs(outer - border - line / 2), isHidden = share(-outer) && share(-outer) * share(distance(1));
    hidden.data[pixel + 3] = 255 * isHidden;
    let [red, green, blue, alpha] = [0, 0, 0, 0];
    for (const [colour, part] of [[HIDDEN, isHidden / 2], [BORDER, share(line / 2 + border - middle)], [OUTLINE, share(line / 2 - middle)]]) if (part) {
      red += part * (colour[0] - red); green += part * (colour[1] - green); blue += part * (colour[2] - blue); alpha += part * (1 - alpha);
    }
    if (alpha) lines.data.set([red / alpha, green / alpha, blue / alpha, 255 * alpha], pixel);
  }
  return { lines, hidden };
};
