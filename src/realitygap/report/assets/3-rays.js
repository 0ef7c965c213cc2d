// Rays of the sensors: up to whatever they meet, or as far as they matter; the stronger, the more a sensor says.
function distanceAlong(arena, x, y, dx, dy, reach) {
  const [width, depth] = arena.size_cm;
  const walls = [[0, 0, width, 0], [width, 0, width, depth], [width, depth, 0, depth], [0, depth, 0, 0], ...arena.walls];
  let nearest = reach;
  for (const [x0, y0, x1, y1] of walls) {
    const [ax, ay] = [x1 - x0, y1 - y0];
    const across = dx * ay - dy * ax;
    if (across === 0) continue;
    const far = ((x0 - x) * ay - (y0 - y) * ax) / across;
    const place = ((x0 - x) * dy - (y0 - y) * dx) / across;
    if (far >= 0 && place >= 0 && place <= 1 && far < nearest) nearest = far;
  }
  for (const [cx, cy, radius] of arena.cylinders) {
    const middle = (cx - x) * dx + (cy - y) * dy;
    const miss = (cx - x) ** 2 + (cy - y) ** 2 - middle ** 2;
    if (miss >= radius ** 2) continue;
    const far = middle - Math.sqrt(radius ** 2 - miss);
    if (far >= 0 && far < nearest) nearest = far;
  }
  return nearest;
}

// 0 where a sensor sees nothing, 1 where it sees all that it can.
function strength(sensor, reading) {
  return Math.min(1, Math.max(0, (reading - sensor.dull) / (sensor.bright - sensor.dull)));
}

function drawRays(stage, arena, sensors, pose, readings, paint) {
  const { pen } = stage;
  const [cos, sin] = [Math.cos(pose.heading), Math.sin(pose.heading)];
  sensors.each.forEach((sensor, i) => {
    const x = pose.x + cos * sensor.x - sin * sensor.y;
    const y = pose.y + sin * sensor.x + cos * sensor.y;
    const share = readings === null ? 0 : strength(sensor, readings[i]);
    const ends = sensors.rays.map((beta) => {
      const angle = pose.heading + ((sensor.direction + beta) * Math.PI) / 180;
      const [dx, dy] = [Math.cos(angle), Math.sin(angle)];
      // Light has no end but the walls: its rays are as long as there is light, and as the sensor faces them.
      const facing = sensor.petals ? (0.12 + 0.88 * share) * Math.cos((beta * Math.PI) / 180) ** 2 : 1;
      const far = distanceAlong(arena, x, y, dx, dy, sensor.reach * facing);
      return [x + far * dx, y + far * dy];
    });
    pen.fillStyle = paint.ray;
    pen.globalAlpha = (sensor.petals ? 0.3 : 0.42) * share;
    pen.beginPath();
    pen.moveTo(stage.x(x), stage.y(y));
    for (const [ex, ey] of ends) pen.lineTo(stage.x(ex), stage.y(ey));
    pen.fill();
    pen.globalAlpha = 0.16 + 0.6 * share;
    pen.strokeStyle = paint.ray;
    pen.lineWidth = 0.5 + share;
    for (const [ex, ey] of ends) line(stage, x, y, ex, ey);
  });
  pen.globalAlpha = 1;
}

// The sensors themselves, on the robot: dots that fill as they read more.
function drawSensors(stage, sensors, pose, readings, paint) {
  const { pen, scale } = stage;
  const [cos, sin] = [Math.cos(pose.heading), Math.sin(pose.heading)];
  sensors.each.forEach((sensor, i) => {
    const x = pose.x + cos * sensor.x - sin * sensor.y;
    const y = pose.y + sin * sensor.x + cos * sensor.y;
    circle(stage, x, y, Math.max(0.3, 1.6 / scale));
    pen.globalAlpha = readings === null ? 0.3 : 0.3 + 0.7 * strength(sensor, readings[i]);
    pen.fillStyle = paint.ray;
    pen.fill();
  });
  pen.globalAlpha = 1;
}
