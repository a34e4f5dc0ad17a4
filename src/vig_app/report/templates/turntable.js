// One object of a page: in 3-D on the canvas `model`, turned by dragging and by the arrow keys, and in poses before its photo.
let mesh = null, pose = null, azimuth, elevation, light = 0, turnsLight = false;
const load = next => { forget(); mesh = opened(next); };

// The object in front of the photo's window, which is the first of the panels.
const drawPose = (canvas, pose, panels, place) => {
  const context = canvas.getContext("2d"), { width, height } = canvas;
  context.drawImage(panels, ...place, 0, 0, width, height);
  if (draw) { draw(mesh, pose, pose.clip, width, height, 0, 0); context.drawImage(glCanvas, 0, 0); }
};
const model = get("model");
const drawModel = () => {
  if (!draw || !pose) return;
  draw(mesh, pose, turned(mesh, azimuth, elevation), model.width, model.height, 1, light);
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
