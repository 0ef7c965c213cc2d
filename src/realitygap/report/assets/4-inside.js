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
