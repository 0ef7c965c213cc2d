// The arena and what drives in it, to scale, on a canvas; lengths in cm, y up.
function colours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "muted", "floor", "wall", "cylinder", "body", "ray", "paper", "grid"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue("--" + name).trim()]));
}

// A canvas as sharp as the screen; its width is the page's, its height follows.
function fitCanvas(canvas, ratio) {
  const wide = canvas.clientWidth;
  const tall = Math.round(wide * ratio);
  const dense = Math.min(window.devicePixelRatio || 1, 3);
  if (canvas.width !== Math.round(wide * dense) || canvas.height !== Math.round(tall * dense)) {
    canvas.width = Math.round(wide * dense);
    canvas.height = Math.round(tall * dense);
    canvas.style.aspectRatio = `${wide} / ${tall}`;
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(dense, 0, 0, dense, 0, 0);
  pen.clearRect(0, 0, wide, tall);
  return { pen, wide, tall };
}

const MARGIN = { left: 22, right: 12, top: 8, bottom: 20 };

// A stage: the pen, and how cm become pixels.
function openStage(canvas, arena) {
  const [width, depth] = arena.size_cm;
  const ticks = MARGIN.left + 7 * Math.max(0, `${Math.floor(depth)}`.length - 2); // the longest is whole
  const free = Math.max(1, canvas.clientWidth - ticks - MARGIN.right);
  const room = Math.min(free, (1.5 * free * width) / depth); // a deep room fits the window
  const left = ticks + (free - room) / 2;
  const ratio = ((room * depth) / width + MARGIN.top + MARGIN.bottom) / Math.max(1, canvas.clientWidth);
  const { pen, wide, tall } = fitCanvas(canvas, ratio);
  const scale = room / width;
  const x = (cm) => left + cm * scale;
  const y = (cm) => MARGIN.top + (depth - cm) * scale;
  return { pen, wide, tall, scale, x, y, width, depth };
}

function circle(stage, x, y, radius) {
  stage.pen.beginPath();
  stage.pen.arc(stage.x(x), stage.y(y), radius * stage.scale, 0, 2 * Math.PI);
}

function drawArena(stage, arena, paint) {
  const { pen, x, y, scale, width, depth } = stage;
  pen.fillStyle = paint.floor;
  pen.fillRect(x(0), y(depth), width * scale, depth * scale);
  pen.save();
  pen.beginPath();
  pen.rect(x(0), y(depth), width * scale, depth * scale);
  pen.clip();
  for (const lamp of arena.lamps) drawGlow(stage, lamp);
  pen.restore();
  pen.lineWidth = 1;
  pen.strokeStyle = paint.wall;
  for (const [cx, cy, radius] of arena.cylinders) {
    circle(stage, cx, cy, radius);
    pen.fillStyle = paint.cylinder;
    pen.fill();
    pen.stroke();
  }
  nameSurfaces(stage, arena, paint);
  pen.lineWidth = 2;
  for (const [x0, y0, x1, y1] of arena.walls) line(stage, x0, y0, x1, y1);
  pen.strokeRect(x(0), y(depth), width * scale, depth * scale);
  pen.fillStyle = "#e69f00";
  for (const lamp of arena.lamps)
    for (const [px, py] of lamp.points) {
      pen.beginPath();
      pen.arc(x(px), y(py), 2.5, 0, 2 * Math.PI);
      pen.fill();
    }
  drawTicks(stage, paint);
}

// How much more than usual surfaces throw back, where that is said of them.
function nameSurfaces(stage, arena, paint) {
  const { pen, x, y } = stage;
  if (!arena.reflectance) return;
  const [walls, ...posts] = arena.reflectance;
  pen.fillStyle = paint.ink;
  pen.font = "11px sans-serif";
  [pen.textAlign, pen.textBaseline] = ["center", "middle"];
  posts.forEach((value, k) => pen.fillText(`×${value}`, x(arena.cylinders[k][0]), y(arena.cylinders[k][1])));
  [pen.textAlign, pen.textBaseline] = ["left", "bottom"];
  pen.fillText(`walls ×${walls}`, x(0) + 4, y(0) - 4);
}

function drawGlow(stage, lamp) {
  const { pen, x, y, scale } = stage;
  const glow = pen.createRadialGradient(x(lamp.x), y(lamp.y), 0, x(lamp.x), y(lamp.y), 40 * scale);
  glow.addColorStop(0, "rgba(230, 159, 0, 0.5)");
  glow.addColorStop(0.25, "rgba(230, 159, 0, 0.2)");
  glow.addColorStop(1, "rgba(230, 159, 0, 0)");
  pen.fillStyle = glow;
  pen.fillRect(0, 0, stage.wide, stage.tall);
}

function drawTicks(stage, paint) {
  const { pen, x, y, scale, width, depth } = stage;
  const gap = [1, 2, 5, 10, 20, 50, 100, 200, 500].find((cm) => cm * scale >= 52) || 1000;
  pen.font = "10.5px system-ui, sans-serif";
  pen.fillStyle = paint.muted;
  pen.textAlign = "center";
  pen.textBaseline = "top";
  for (let cm = 0; cm <= width + 1e-9; cm += gap) pen.fillText(`${cm}`, x(cm), y(0) + 5);
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  for (let cm = gap; cm < depth + 1e-9; cm += gap) pen.fillText(`${cm}`, x(0) - 5, y(cm));
  pen.fillText("cm", x(0) - 5, y(0) + 10);
}

function line(stage, x0, y0, x1, y1) {
  stage.pen.beginPath();
  stage.pen.moveTo(stage.x(x0), stage.y(y0));
  stage.pen.lineTo(stage.x(x1), stage.y(y1));
  stage.pen.stroke();
}

// The paper's tail: a line from the centre to the leading edge for each step so far.
function drawTail(stage, track, position, look, front) {
  const { pen, x, y } = stage;
  pen.strokeStyle = look.colour;
  pen.globalAlpha = look.alpha;
  pen.lineWidth = look.width;
  pen.setLineDash(look.dash);
  pen.beginPath();
  for (let k = 0; k <= Math.floor(position); k++) {
    const pose = track.pose(k);
    if (pose === null) continue;
    pen.moveTo(x(pose.x), y(pose.y));
    pen.lineTo(x(pose.x + front * Math.cos(pose.heading)), y(pose.y + front * Math.sin(pose.heading)));
  }
  pen.stroke();
  pen.setLineDash([]);
  pen.globalAlpha = 1;
}

// Where a robot goes in all, faintly, and a ring where it began.
function drawCourse(stage, track, paint) {
  const { pen, x, y } = stage;
  pen.strokeStyle = paint.muted;
  pen.globalAlpha = 0.35;
  pen.lineWidth = 1;
  pen.beginPath();
  let joined = false;
  for (let k = 0; k <= track.steps; k++) {
    const pose = track.pose(k);
    if (pose === null) joined = false;
    else if (joined) pen.lineTo(x(pose.x), y(pose.y));
    else pen.moveTo(x(pose.x), y(pose.y));
    joined = pose !== null;
  }
  pen.stroke();
  pen.globalAlpha = 1;
  const first = track.pose(0);
  if (first === null) return;
  pen.beginPath();
  pen.arc(x(first.x), y(first.y), 3.5, 0, 2 * Math.PI);
  pen.fillStyle = paint.paper;
  pen.fill();
  pen.strokeStyle = paint.ink;
  pen.stroke();
}

// The robot: body, wheels, and a line to its leading edge, as in the report's figures.
function drawRobot(stage, robot, pose, look, paint) {
  const { pen, scale } = stage;
  const [long, wide] = robot.wheel;
  pen.save();
  pen.translate(stage.x(pose.x), stage.y(pose.y));
  pen.rotate(-pose.heading);
  pen.beginPath();
  if (robot.outline.length) robot.outline.forEach(([x, y]) => pen.lineTo(x * scale, -y * scale));
  else pen.arc(0, 0, robot.radius * scale, 0, 2 * Math.PI);
  pen.closePath();
  pen.fillStyle = look.body;
  pen.fill();
  pen.lineWidth = 2;
  pen.strokeStyle = look.colour;
  pen.setLineDash(look.dash);
  pen.stroke();
  pen.setLineDash([]);
  pen.fillStyle = pen.strokeStyle = paint.ink;
  for (const side of [-1, 1]) {
    const middle = side * (robot.track / 2 - wide / 2) * scale;
    pen.fillRect((-long / 2) * scale, middle - (wide / 2) * scale, long * scale, wide * scale);
  }
  pen.beginPath();
  pen.moveTo(0, 0);
  pen.lineTo(robot.front * scale, 0);
  pen.stroke();
  pen.restore();
}
