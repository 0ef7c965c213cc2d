// What the page holds, unpacked. Numbers come as the bytes of int16 or int8 in base64.
const LOST = -32768;

function bytesOf(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

function int16(text) {
  const view = new DataView(bytesOf(text).buffer);
  const numbers = new Int16Array(view.byteLength / 2);
  for (let i = 0; i < numbers.length; i++) numbers[i] = view.getInt16(2 * i, true);
  return numbers;
}

const int8 = (text) => new Int8Array(bytesOf(text).buffer);

// One drive: pose(k), and rows of readings, commands and outputs, null where they are not known.
function openTrack(packed, unitCm) {
  const poses = int16(packed.poses);
  const rows = (text, open) => {
    if (text === null) return () => null;
    const values = open(text);
    const wide = values.length / packed.steps;
    return (k) => values.subarray(Math.min(k, packed.steps - 1) * wide, Math.min(k + 1, packed.steps) * wide);
  };
  const pose = (k) => {
    const [x, y, heading] = poses.subarray(3 * k, 3 * k + 3);
    if (x === LOST || y === LOST || heading === LOST) return null;
    return { x: x * unitCm, y: y * unitCm, heading: (heading / 100) * (Math.PI / 180) };
  };
  return {
    who: packed.who,
    score: packed.score,
    steps: packed.steps,
    pose,
    readings: rows(packed.readings, int16),
    commands: rows(packed.commands, int8),
    outputs: rows(packed.outputs, int8),
  };
}

// Where a robot is between two steps, straight across and by the shorter turn; null where it is lost.
function poseBetween(track, position) {
  const k = Math.min(Math.floor(position), track.steps);
  const from = track.pose(k);
  const share = position - k;
  const to = share > 0 && k < track.steps ? track.pose(k + 1) : null;
  if (from === null || to === null) return from;
  const turn = Math.atan2(Math.sin(to.heading - from.heading), Math.cos(to.heading - from.heading));
  return {
    x: from.x + share * (to.x - from.x),
    y: from.y + share * (to.y - from.y),
    heading: from.heading + share * turn,
  };
}

// How far from each other two robots are at each step, cm; NaN where one of them is lost.
function apartOf(first, second) {
  const steps = Math.min(first.steps, second.steps);
  return Array.from({ length: steps + 1 }, (_, k) => {
    const [a, b] = [first.pose(k), second.pose(k)];
    return a && b ? Math.hypot(a.x - b.x, a.y - b.y) : NaN;
  });
}

// A number with a true minus sign and so many places.
const written = (value, places = 0) => value.toFixed(places).replace("-", "−");

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

// What goes on inside a robot: its readings and commands as bars, its network as a picture that lights up.
const SVG = "http://www.w3.org/2000/svg";

function made(name, attributes = {}, parent = null, text = null) {
  const element = name.startsWith("svg:")
    ? document.createElementNS(SVG, name.slice(4))
    : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== null) element.textContent = text;
  if (parent) parent.append(element);
  return element;
}

// Upright bars for the sensors, eight in a row; returns a function that shows one row of readings.
function makeReadings(box, sensors) {
  box.replaceChildren();
  box.style.gridTemplateColumns = `repeat(${Math.min(8, sensors.each.length)}, minmax(0, 1fr))`;
  const bars = sensors.each.map((sensor, i) => {
    const column = made("div", { class: "bar" + (sensors.fed.includes(i) ? "" : " unfed") }, box);
    const value = made("b", {}, column, "–");
    const fill = made("i", {}, made("span", {}, column));
    made("small", {}, column, `${i}`);
    return { value, fill, sensor };
  });
  return (readings) =>
    bars.forEach(({ value, fill, sensor }, i) => {
      const count = readings === null ? null : readings[i];
      value.textContent = count === null ? "–" : written(count);
      fill.style.transform = `scaleY(${count === null ? 0 : Math.min(1, Math.max(0, count / sensor.top))})`;
      fill.style.opacity = count === null ? 0 : 0.45 + 0.55 * strength(sensor, count);
    });
}

// Bars to both sides of a middle, one a wheel; returns a function that shows one pair of commands.
function makeCommands(box) {
  box.replaceChildren();
  const bars = ["left", "right"].map((wheel) => {
    const row = made("div", { class: "command" }, box);
    made("span", {}, row, wheel);
    const fill = made("i", {}, made("span", { class: "track" }, row));
    return { fill, value: made("b", {}, row, "–") };
  });
  return (commands) =>
    bars.forEach(({ fill, value }, i) => {
      const speed = commands === null ? 0 : commands[i];
      value.textContent = commands === null ? "–" : written(speed);
      fill.style.transform = `scaleX(${Math.min(1, Math.max(-1, speed / 10))})`;
    });
}

// The network in its place on the robot, which looks up; returns a function that shows one row of outputs.
function makeNetwork(svg, network, robot) {
  svg.replaceChildren();
  const { neurons, links, unit } = network;
  const reach = (n) => Math.max(robot.radius, ...neurons.map(n)) + 0.15;
  const [wide, low] = [reach((n) => Math.abs(n.x) + n.r), reach((n) => n.y + n.r)];
  const high = reach((n) => n.r - n.y);
  svg.setAttribute("viewBox", `${-wide} ${-high} ${2 * wide} ${high + low}`);
  const corners = robot.outline.map(([x, y]) => `${-y},${-x}`).join(" ");
  if (corners) made("svg:polygon", { points: corners, class: "hull" }, svg);
  else made("svg:circle", { r: robot.radius, class: "hull" }, svg);
  const lines = links.map((link) => {
    const kind = (link.weight < 0 ? "inhibits" : "excites") + (link.works ? "" : " idle");
    const group = made("svg:g", { class: `link ${kind}` }, svg);
    made("svg:path", { d: smooth(link.points), "stroke-width": unit * (0.02 + 0.022 * Math.abs(link.weight)) }, group);
    made("svg:path", { d: linkEnd(link, unit), class: "end" }, group);
    made("svg:title", {}, group, linkWords(link, neurons));
    return group;
  });
  const discs = neurons.map((neuron) => drawNeuron(svg, neuron, unit));
  return (outputs) => {
    neurons.forEach((_, i) => lightNeuron(discs[i], outputs === null ? null : outputs[i]));
    links.forEach((link, i) => {
      const pull = outputs === null ? 0 : Math.abs(outputs[link.from] * link.weight);
      lines[i].style.opacity = link.works ? 0.16 + 0.84 * Math.min(1, pull / 24) : 0.1;
    });
  };
}

// A curve through the middles between points, bent by the points: no corners show.
function smooth(points) {
  const [x, y] = points[0];
  const bends = points.slice(1, -1).map(([bx, by], i) => {
    const [nx, ny] = points[i + 2];
    return `Q${bx} ${by} ${((bx + nx) / 2).toFixed(3)} ${((by + ny) / 2).toFixed(3)}`;
  });
  return `M${x} ${y}${bends.join("")}L${points[points.length - 1].join(" ")}`;
}

function linkWords(link, neurons) {
  const delay = link.delay ? `, ${link.delay} updates late` : "";
  return `${neurons[link.from].name} → ${neurons[link.to].name}: weight ${written(link.weight)}${delay}`;
}

// An arrow where a link excites, a dot where it inhibits: not told by colour alone.
function linkEnd(link, unit) {
  const points = link.points;
  const [x, y] = points[points.length - 1];
  const [bx, by] = points[points.length - 2];
  const size = unit * (0.1 + 0.02 * Math.abs(link.weight));
  if (link.weight < 0)
    return `M${x - size * 0.7} ${y}a${size * 0.7} ${size * 0.7} 0 1 0 ${size * 1.4} 0a${size * 0.7} ${size * 0.7} 0 1 0 ${-size * 1.4} 0`;
  const long = Math.hypot(x - bx, y - by) || 1;
  const [ux, uy] = [((x - bx) / long) * size, ((y - by) / long) * size];
  return `M${x + ux * 0.4} ${y + uy * 0.4}L${x - ux * 1.3 - uy * 0.8} ${y - uy * 1.3 + ux * 0.8}L${x - ux * 1.3 + uy * 0.8} ${y - uy * 1.3 - ux * 0.8}Z`;
}

function drawNeuron(svg, neuron, unit) {
  const { x, y, r } = neuron;
  const group = made("svg:g", { class: `neuron ${neuron.kind}${neuron.useful ? "" : " idle"}` }, svg);
  const square = { x: x - r, y: y - r, width: 2 * r, height: 2 * r };
  const shape = (more) =>
    neuron.kind === "output"
      ? made("svg:rect", { ...square, ...more }, group)
      : made("svg:circle", { cx: x, cy: y, r, ...more }, group);
  shape({ class: "rim" });
  const glow = shape({ class: "glow", transform: `translate(${x} ${y}) scale(0.84) translate(${-x} ${-y})` });
  const text = (dy, size, name, words) =>
    made("svg:text", { x, y: y + dy * unit, "font-size": size * unit, class: name }, group, words);
  const value = text(0.07, 0.3, "value", "");
  text(-0.18, 0.18, "name", neuron.name);
  const kind = { input: "sensor", output: "wheel", hidden: "hidden neuron" }[neuron.kind];
  const threshold = neuron.kind === "input" ? "" : `, threshold ${written(neuron.threshold)}`;
  made("svg:title", {}, group, `${kind} ${neuron.name}${threshold}`);
  return { group, glow, value };
}

function lightNeuron({ group, glow, value }, output) {
  value.textContent = output === null ? "–" : written(output);
  group.classList.toggle("negative", output !== null && output < 0);
  glow.style.opacity = output === null ? 0 : 0.08 + (0.92 * Math.abs(output)) / 10;
  if (output === 0) glow.style.opacity = 0;
}

// A link to one run, trial and moment: in the address, and to copy.
const SLOW_MS = 300; // browsers let a page rewrite its address so many times a minute and no oftener
const IN_ADDRESS = "It is in the address bar.";

function makeLink(root, choice, time) {
  const anchor = byId("player-link");
  const lost = byId("player-lost");
  let waiting = 0;

  function address() {
    const [, , run, trial] = choice.chosen();
    const second = time.second();
    const at = second === null ? "" : `&at=${second}`;
    const plain = (text) => encodeURIComponent(text).replaceAll("%2F", "/");
    return `#run=${plain(run.link)}&trial=${plain(trial.link)}${at}`;
  }

  // After a change; one that a person made goes into the address as well.
  function renew(byHand) {
    anchor.href = address();
    if (!byHand) return;
    lost.hidden = true;
    clearTimeout(waiting);
    waiting = setTimeout(enter, SLOW_MS);
  }

  function enter() {
    try {
      history.replaceState(null, "", anchor.href);
    } catch {
      // an address that cannot be rewritten; the link beside the player still can be copied
    }
  }

  function tell(words) {
    byId("player-linked").textContent = words;
    setTimeout(() => (byId("player-linked").textContent = ""), 3000);
  }

  // Goes where the address points, if that is a run.
  function follow() {
    const asked = new URLSearchParams(location.hash.slice(1));
    if (!asked.has("run")) return;
    const found = choice.find(asked.get("run"), asked.get("trial"));
    lost.hidden = found;
    const second = Number.parseFloat(asked.get("at"));
    if (found && Number.isFinite(second)) time.go(second);
    root.scrollIntoView({ behavior: "instant" });
  }

  anchor.addEventListener("click", (event) => {
    event.preventDefault();
    enter();
    navigator.clipboard?.writeText(anchor.href).then(() => tell("Link copied."), () => tell(IN_ADDRESS));
    if (!navigator.clipboard) tell(IN_ADDRESS);
  });
  window.addEventListener("hashchange", follow);
  return { renew, follow };
}

// The player: what is chosen, where in the trial it is, and everything that shows it.
const still = window.matchMedia("(prefers-reduced-motion: reduce)");
const byId = (id) => document.getElementById(id);

function openPlayer() {
  const source = byId("player-data");
  if (!source) return;
  const data = JSON.parse(source.textContent);
  const [root, deck] = [byId("player"), byId("player-deck")];
  const now = { position: 0, playing: false, before: 0 };
  let scene = null;
  const parts = {
    arenas: [byId("player-arena-0"), byId("player-arena-1")],
    time: byId("player-time"),
    scrub: byId("player-scrub"),
    play: byId("player-play"),
    said: byId("player-said"),
    apart: byId("player-apart"),
    apartWords: byId("player-apart-words"),
  };
  const choice = makeChoice(data, (chosen, byHand) => {
    scene = openScene(data, chosen);
    now.playing = false;
    now.position = 0;
    parts.scrub.max = scene.steps;
    arrange();
    show();
    link.renew(byHand);
  });
  const places = `${data.step_s}`.split(".")[1]?.length ?? 1; // of a time, so that no two steps have the same
  const link = makeLink(root, choice, {
    second: () => (now.position > 1e-9 ? (now.position * data.step_s).toFixed(places) : null),
    go: (second) => goTo(second / data.step_s),
  });

  // Fills in all that changes with the choice and not with time.
  function arrange() {
    const { sides, alone } = scene;
    root.classList.toggle("alone", alone);
    root.classList.toggle("wide-arena", scene.task.arena.size_cm[0] > 1.3 * scene.task.arena.size_cm[1]);
    for (const side of [0, 1]) {
      for (const box of root.querySelectorAll(`[data-side="${side}"]`)) box.hidden = side === 1 && alone;
      if (side === 1 && alone) continue;
      const { track } = sides[side];
      const unit = scene.task.unit ? ` ${scene.task.unit}` : "";
      byId(`player-who-${side}`).textContent = track.who;
      byId(`player-score-${side}`).textContent = `this trial’s score: ${track.score}${unit}`;
      byId(`player-inside-${side}`).textContent = `Inside: ${track.who}`;
      const kinds = { proximity: "Infrared: counts, high is near", ambient: "Ambient light: counts, low is bright" };
      const fed = scene.task.feeds.split("+");
      byId(`player-kind-${side}`).textContent = fed.map((kind) => kinds[kind]).join("; ");
    }
    byId("player-alone")?.toggleAttribute("hidden", !alone);
    byId("player-unread").hidden = sides.every(({ track }) => track.readings(0) && track.outputs(0));
    root.style.setProperty("--noise", scene.noise.colour);
  }

  // Draws one moment; words only where they changed.
  function show() {
    const step = Math.min(Math.floor(now.position + 1e-9), scene.steps);
    const paint = colours();
    scene.sides.forEach((side, i) => {
      drawScene(parts.arenas[i], scene, side, now.position, paint);
      side.inside(side.track.readings(step), side.track.commands(step), side.track.outputs(step));
      const pose = side.track.pose(step);
      const place = pose ? `at ${written(pose.x)}, ${written(pose.y)} cm` : "not seen by the camera";
      parts.arenas[i].setAttribute("aria-label", `${side.track.who} robot in its arena, ${place}`);
    });
    const [at, end] = [step * data.step_s, scene.steps * data.step_s];
    parts.time.textContent = `${at.toFixed(places)} of ${end.toFixed(places)} s`;
    parts.scrub.value = step;
    parts.scrub.setAttribute("aria-valuetext", parts.time.textContent);
    parts.play.classList.toggle("on", now.playing);
    parts.play.setAttribute("aria-label", now.playing ? "Pause" : "Play");
    byId("player-mark").hidden = now.playing || now.position > 0;
    if (!scene.alone) showApart(parts, scene, step, paint);
  }

  function say() {
    const step = Math.floor(now.position + 1e-9);
    const where = scene.sides.map(({ track }) => {
      const pose = track.pose(Math.min(step, track.steps));
      return `${track.who} robot ${pose ? `at ${written(pose.x)}, ${written(pose.y)} cm` : "lost"}`;
    });
    parts.said.textContent = `${parts.time.textContent}: ${where.join("; ")}.`;
  }

  function play(on) {
    if (on && now.position >= scene.steps) now.position = 0;
    now.playing = on;
    now.before = performance.now();
    parts.said.textContent = "";
    if (on) requestAnimationFrame(tick);
    else {
      say();
      link.renew(true);
    }
    show();
  }

  function tick(time) {
    if (!now.playing) return;
    now.position = Math.min(scene.steps, now.position + stepsGone(now, time, data.step_s));
    if (now.position >= scene.steps) return play(false);
    show();
    requestAnimationFrame(tick);
  }

  // To a step; a person who looks at one moment does not want it to run away.
  function goTo(step, stop = true) {
    now.position = Math.min(scene.steps, Math.max(0, Math.round(step)));
    if (stop && now.playing) return play(false);
    show();
    link.renew(true);
  }

  parts.play.addEventListener("click", () => play(!now.playing));
  deck.addEventListener("click", () => play(!now.playing));
  parts.scrub.addEventListener("input", () => goTo(Number(parts.scrub.value), false));
  parts.scrub.addEventListener("change", () => now.playing || say());
  byId("player-back").addEventListener("click", () => goTo(Math.ceil(now.position) - 1));
  byId("player-on").addEventListener("click", () => goTo(Math.floor(now.position) + 1));
  for (const name of ["rays", "tails"]) byId(`player-${name}`).addEventListener("change", show);
  // Keys are the player's where it has the focus, or nothing has and it is to be seen.
  document.addEventListener("keydown", (event) => {
    const free = event.target === document.body || event.target === document.documentElement;
    if (free ? !inSight(root) : !root.contains(event.target)) return;
    const act = keyAction(event, now.position, scene.steps);
    if (act === null) return;
    event.preventDefault();
    if (free) [parts.play, deck].forEach((one) => one.scrollIntoView({ block: "nearest", behavior: "instant" }));
    if (act === "play") play(!now.playing);
    else {
      goTo(act);
      say();
    }
  });
  window.addEventListener("resize", show);
  onPrint(() => {
    if (now.position === 0) now.position = scene.steps; // paper shows the whole drive
    byId("player-still").textContent = `${choice.title()}, after ${parts.time.textContent}.`;
    show();
  });
  document.addEventListener("themechange", show);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
  root.hidden = false;
  choice.first();
  link.follow();
  // Once, when a person first sees it; not if a link led to a moment, or they want nothing to move.
  if (still.matches || location.hash.includes("run=")) return;
  const seen = new IntersectionObserver(([one]) => {
    if (!one.isIntersecting) return;
    seen.disconnect();
    if (now.position === 0 && !now.playing && !root.classList.contains("driving")) play(true);
  }, { threshold: 0.6 });
  seen.observe(byId("player-arena-0"));
}

function inSight(element) {
  const { top, bottom } = element.getBoundingClientRect();
  return bottom > 0 && top < window.innerHeight;
}

// What a key asks for: "play", a step to go to, or null where it is the control's own or nobody's.
function keyAction(event, position, steps) {
  if (event.ctrlKey || event.altKey || event.metaKey) return null;
  const tag = event.target.tagName;
  const isRange = event.target.type === "range";
  const isTyped = tag === "INPUT" && !isRange && event.target.type !== "checkbox";
  if (isTyped || event.target.isContentEditable || tag === "TEXTAREA") return null;
  if (tag === "SELECT" || tag === "SUMMARY" || (event.repeat && event.key === " ")) return null;
  if (event.key === " ") return tag === "BUTTON" || event.target.type === "checkbox" ? null : "play";
  const far = event.shiftKey ? 10 : 1;
  if (event.key === "ArrowLeft") return Math.ceil(position) - far;
  if (event.key === "ArrowRight") return Math.floor(position) + far;
  if (event.key === "Home" && !isRange) return 0;
  if (event.key === "End" && !isRange) return steps;
  return /^[0-9]$/.test(event.key) ? Math.round((Number(event.key) / 10) * steps) : null;
}

// The lists a person chooses from; each follows from those before it.
function makeChoice(data, changed) {
  const lists = ["task", "noise", "run", "trial"].map((name) => byId(`player-${name}`));
  const inside = [() => data.tasks, (task) => task.noises, (noise) => noise.runs, (run) => run.trials];
  const title = (one) => one.title || one.name;

  // What is chosen in the first so many lists.
  function chosen(many = lists.length) {
    const picked = [];
    for (let level = 0; level < many; level++)
      picked.push(inside[level](picked[level - 1])[lists[level].selectedIndex]);
    return picked;
  }

  // Fills the lists from `level` on, each with what stood there before if it is there still.
  function fill(level) {
    for (let i = level; i < lists.length; i++) {
      const above = chosen(i).at(-1);
      const options = inside[i](above);
      const before = lists[i].value;
      lists[i].replaceChildren(...options.map((one) => made("option", {}, null, title(one))));
      const kept = options.findIndex((one) => title(one) === before);
      lists[i].selectedIndex = kept >= 0 && i < 2 ? kept : i === 2 ? above.shown : 0;
    }
    byId("player-trial-label").hidden = lists[3].length < 2;
  }

  // Chooses what a link names; says whether the page holds it.
  function find(run, trial) {
    const named = (one, link) => one.link === link;
    for (const [t, task] of data.tasks.entries())
      for (const [n, noise] of task.noises.entries()) {
        const r = noise.runs.findIndex((one) => named(one, run));
        const k = r < 0 ? -1 : trial === null ? 0 : noise.runs[r].trials.findIndex((one) => named(one, trial));
        if (k < 0) continue;
        [t, n, r, k].forEach((index, level) => {
          fill(level);
          lists[level].selectedIndex = index;
        });
        changed(chosen(), false);
        return true;
      }
    return false;
  }

  lists.forEach((list, level) =>
    list.addEventListener("change", () => {
      if (level < 3) fill(level + 1);
      changed(chosen(), true);
    }),
  );
  const first = () => {
    fill(0);
    changed(chosen(), false);
  };
  return { first, find, chosen, title: () => chosen().map(title).join(", ") };
}

// A trial, ready to be shown: one or two sides, each with the functions that show it.
function openScene(data, [task, noise, run, trial]) {
  const packed = [trial.simulated, trial.driven].filter((one) => one !== null);
  const sides = packed.map((one, i) => ({
    track: openTrack(one, task.unit_cm),
    driven: i === 1,
    inside: makeInside(i, task, run, data.robot),
  }));
  const alone = sides.length === 1;
  const apart = alone ? [] : apartOf(sides[0].track, sides[1].track);
  return { task, noise, sides, alone, apart, robot: data.robot, steps: Math.max(...packed.map((one) => one.steps)) };
}

// One side's bars and network; returns a function that shows its rows of readings, commands and outputs.
function makeInside(side, task, run, robot) {
  const readings = makeReadings(byId(`player-readings-${side}`), task.sensors);
  const commands = makeCommands(byId(`player-commands-${side}`));
  const network = makeNetwork(byId(`player-network-${side}`), run.network, robot);
  return (...rows) => [readings, commands, network].forEach((show, i) => show(rows[i]));
}

// One side's arena at a moment. The looks are those of the report's figures: a robot that was driven is grey and dashed.
function drawScene(canvas, scene, side, position, paint) {
  const { task, noise, robot } = scene;
  const colour = noise.colour;
  const look = side.driven
    ? { colour, width: 2, alpha: 0.7, dash: [3, 1.5], body: paint.cylinder }
    : { colour, width: 1.1, alpha: 1, dash: [], body: paint.body };
  const { track } = side;
  const at = Math.min(still.matches ? Math.floor(position) : position, track.steps);
  const shown = { pose: poseBetween(track, at), readings: track.readings(Math.floor(at)), course: track, tail: track, at };
  drawMoment(canvas, task, robot, look, shown, paint);
}

// A robot in its arena, with a faint course, the tail of a track up to a moment, and what else lies under it.
function drawMoment(canvas, task, robot, look, { pose, readings, course, tail, at, under }, paint) {
  const stage = openStage(canvas, task.arena);
  drawArena(stage, task.arena, paint);
  if (pose && byId("player-rays").checked) drawRays(stage, task.arena, task.sensors, pose, readings, paint);
  if (course) drawCourse(stage, course, paint);
  if (tail && byId("player-tails").checked) drawTail(stage, tail, at, look, robot.front);
  under?.(stage);
  if (pose) drawRobot(stage, robot, pose, look, paint);
  if (pose) drawSensors(stage, task.sensors, pose, readings, paint);
  return stage;
}

// How many steps a drive goes on until a moment; a page that was away does not catch up.
function stepsGone(now, time, step_s) {
  const gone = Math.min(Math.max(time - now.before, 0), 250) / 1000;
  now.before = Math.max(time, now.before);
  return (gone * Number(byId("player-speed").value)) / step_s;
}

// How far apart the two are, over the whole trial, with a mark at this moment.
function showApart(parts, scene, step, paint) {
  const known = scene.apart.filter((cm) => !Number.isNaN(cm));
  const top = Math.max(5, ...known);
  const cm = scene.apart[Math.min(step, scene.apart.length - 1)];
  parts.apartWords.textContent = Number.isNaN(cm) ? "–" : `${written(cm, 1)} cm`;
  const { pen, wide, tall } = fitCanvas(parts.apart, 40 / Math.max(1, parts.apart.clientWidth));
  const x = (k) => 8 + ((wide - 16) * k) / scene.steps;
  const y = (value) => tall - 2 - ((tall - 6) * value) / top;
  pen.strokeStyle = paint.grid;
  pen.beginPath();
  pen.moveTo(x(0), y(0));
  pen.lineTo(x(scene.steps), y(0));
  pen.stroke();
  pen.beginPath();
  scene.apart.forEach((value, k) => {
    const before = k > 0 && !Number.isNaN(scene.apart[k - 1]);
    if (!Number.isNaN(value)) before ? pen.lineTo(x(k), y(value)) : pen.moveTo(x(k), y(value));
  });
  pen.strokeStyle = scene.noise.colour;
  pen.lineWidth = 1.6;
  pen.stroke();
  pen.fillStyle = paint.ink;
  if (!Number.isNaN(cm)) {
    pen.beginPath();
    pen.arc(x(step), y(cm), 3, 0, 2 * Math.PI);
    pen.fill();
  }
}

// The page around the player: light or dark, and tables that a person can sort.
const THEMES = ["auto", "light", "dark"];

function makeTheme() {
  const button = byId("theme");
  const kept = () => {
    try {
      return localStorage.getItem("realitygap-theme");
    } catch {
      return null; // a browser that lets no page from disk keep anything
    }
  };
  const wear = (theme) => {
    if (theme === "auto") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = theme;
    button.textContent = `Theme: ${theme}`;
    button.dataset.now = theme;
    document.dispatchEvent(new Event("themechange"));
  };
  wear(THEMES.includes(kept()) ? kept() : "auto");
  button.hidden = false;
  button.addEventListener("click", () => {
    const theme = THEMES[(THEMES.indexOf(button.dataset.now) + 1) % THEMES.length];
    try {
      localStorage.setItem("realitygap-theme", theme);
    } catch {
      // the next visit begins as the system is
    }
    wear(theme);
  });
}

// Paper is light: what is drawn is drawn so before it is printed, and as it was afterwards.
function onPrint(draw) {
  const { dataset } = document.documentElement;
  let worn;
  window.addEventListener("beforeprint", () => {
    worn = dataset.theme;
    dataset.theme = "light";
    draw();
  });
  window.addEventListener("afterprint", () => {
    if (worn === undefined) delete dataset.theme;
    else dataset.theme = worn;
    draw();
  });
}

// A cell's number, NaN for words: the first number in it, so that "0.71 ± 0.02" is 0.71.
function numberIn(cell) {
  const found = /^[^\d−-]{0,2}([−-]?\d[\d ]*(?:\.\d+)?)/.exec(cell.textContent.trim());
  return found ? Number(found[1].replace("−", "-").replace(/ /g, "")) : NaN;
}

function compareCells(a, b) {
  const [x, y] = [numberIn(a), numberIn(b)];
  if (Number.isNaN(x) && Number.isNaN(y)) return a.textContent.trim().localeCompare(b.textContent.trim());
  return x - y;
}

// Which column each heading stands over, spans counted: [heading, column], of those over one column only.
function leafHeadings(table) {
  const taken = [];
  const leaves = [];
  [...table.tHead.rows].forEach((row, r) => {
    let column = 0;
    for (const cell of row.cells) {
      while (taken[r]?.[column]) column++;
      for (let down = 0; down < cell.rowSpan; down++)
        for (let across = 0; across < cell.colSpan; across++) (taken[r + down] ??= [])[column + across] = true;
      const isLeaf = cell.tagName === "TH" && cell.colSpan === 1 && r + cell.rowSpan === table.tHead.rows.length;
      if (isLeaf) leaves.push([cell, column]);
      column += cell.colSpan;
    }
  });
  return leaves;
}

// The rows of a group that may change places: not its heading, not its average.
function freeRows(body) {
  return [...body.rows].filter((row) => !row.matches(".class, .average"));
}

function sortTable(table, column, direction) {
  for (const body of table.tBodies) {
    const rows = freeRows(body);
    const ordered = [...rows].sort((a, b) => {
      if (direction === "none") return Number(a.dataset.first) - Number(b.dataset.first);
      const [x, y] = [a.cells[column], b.cells[column]];
      const empty = (cell) => !cell || /^[–\s]*$/.test(cell.textContent);
      if (empty(x) || empty(y)) return Number(empty(x)) - Number(empty(y));
      return direction === "ascending" ? compareCells(x, y) : compareCells(y, x);
    });
    const rest = rows.length ? rows[rows.length - 1].nextSibling : null;
    ordered.forEach((row) => body.insertBefore(row, rest));
  }
}

function makeSortable(table) {
  if (!table.tHead || ![...table.tBodies].some((body) => freeRows(body).length > 1)) return;
  for (const body of table.tBodies) freeRows(body).forEach((row, i) => (row.dataset.first = i));
  const leaves = leafHeadings(table);
  leaves.forEach(([heading, column]) => {
    const button = made("button", { type: "button", class: "sort" });
    button.append(...heading.childNodes);
    heading.append(button);
    heading.setAttribute("aria-sort", "none");
    button.addEventListener("click", () => {
      const before = heading.getAttribute("aria-sort");
      const next = { none: "ascending", ascending: "descending", descending: "none" }[before];
      leaves.forEach(([other]) => other.setAttribute("aria-sort", "none"));
      heading.setAttribute("aria-sort", next);
      sortTable(table, column, next);
    });
  });
}

// A link to what lies in a fold opens it.
function openFolds() {
  const target = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  for (let fold = target && target.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
}

makeTheme();
openFolds();
window.addEventListener("hashchange", openFolds);
document.querySelectorAll("main table").forEach(makeSortable);
openPlayer();
