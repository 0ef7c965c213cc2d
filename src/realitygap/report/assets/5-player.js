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
    speed: byId("player-speed"),
    said: byId("player-said"),
    apart: byId("player-apart"),
    apartWords: byId("player-apart-words"),
  };
  const choice = makeChoice(data, (chosen, byHand) => {
    scene = openScene(data, chosen);
    now.playing = false;
    now.position = scene.steps;
    parts.scrub.max = scene.steps;
    arrange();
    show();
    link.renew(byHand);
  });
  const places = `${data.step_s}`.split(".")[1]?.length ?? 1; // of a time, so that no two steps have the same
  const link = makeLink(root, choice, {
    second: () => (now.position < scene.steps - 1e-9 ? (now.position * data.step_s).toFixed(places) : null),
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
      byId(`player-score-${side}`).textContent = `fitness ${track.score}${unit}`;
      byId(`player-inside-${side}`).textContent = `Inside: ${track.who}`;
      const kinds = { proximity: "Infrared: counts, high is near", ambient: "Ambient light: counts, low is bright" };
      const fed = scene.task.feeds.split("+");
      byId(`player-kind-${side}`).textContent = fed.map((kind) => kinds[kind]).join("; ");
    }
    byId("player-alone").hidden = !alone;
    byId("player-unread").hidden = sides.every(({ track }) => track.readings(0) && track.outputs(0));
    root.style.setProperty("--noise", scene.noise.colour);
  }

  // Draws one moment; words only where they changed.
  function show() {
    const step = Math.min(Math.floor(now.position + 1e-9), scene.steps);
    const paint = colours();
    scene.sides.forEach((side, i) => {
      drawScene(parts.arenas[i], scene, side, now.position, paint);
      side.readings(side.track.readings(step));
      side.commands(side.track.commands(step));
      side.network(side.track.outputs(step));
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
    const gone = Math.min(Math.max(time - now.before, 0), 250) / 1000;
    now.before = Math.max(time, now.before);
    now.position = Math.min(scene.steps, now.position + (gone * Number(parts.speed.value)) / data.step_s);
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
    byId("player-still").textContent = `${choice.title()}, after ${parts.time.textContent}.`;
    show();
  });
  document.addEventListener("themechange", show);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
  root.hidden = false;
  choice.first();
  link.follow();
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
  const packed = [trial.simulated, trial.situated].filter((one) => one !== null);
  const sides = packed.map((one, i) => ({
    track: openTrack(one, task.unit_cm),
    situated: i === 1,
    readings: makeReadings(byId(`player-readings-${i}`), task.sensors),
    commands: makeCommands(byId(`player-commands-${i}`)),
    network: makeNetwork(byId(`player-network-${i}`), run.network, data.robot),
  }));
  const alone = sides.length === 1;
  const apart = alone ? [] : apartOf(sides[0].track, sides[1].track);
  return { task, noise, sides, alone, apart, robot: data.robot, steps: Math.max(...packed.map((one) => one.steps)) };
}

// One side's arena at a moment. The looks are those of the report's figures: a situated robot is grey and dashed.
function drawScene(canvas, scene, side, position, paint) {
  const { task, noise, robot } = scene;
  const stage = openStage(canvas, task.arena);
  const colour = noise.colour;
  const look = side.situated
    ? { colour, width: 2, alpha: 0.7, dash: [3, 1.5], body: paint.cylinder }
    : { colour, width: 1.1, alpha: 1, dash: [], body: paint.body };
  const { track } = side;
  const at = Math.min(still.matches ? Math.floor(position) : position, track.steps);
  drawArena(stage, task.arena, paint);
  const pose = poseBetween(track, at);
  const readings = track.readings(Math.floor(at));
  if (pose && byId("player-rays").checked) drawRays(stage, task.arena, task.sensors, pose, readings, paint);
  drawCourse(stage, track, look, paint);
  if (byId("player-tails").checked) drawTail(stage, track, at, look, robot.front);
  if (pose === null) return;
  drawRobot(stage, robot, pose, look, paint);
  drawSensors(stage, task.sensors, pose, readings, paint);
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
