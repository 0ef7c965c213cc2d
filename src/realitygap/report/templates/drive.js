// Drive it yourself: the simulation's own compiled steps, in this page's memory. Lengths in cm.
const MANY = 40; // futures
const AHEAD = 60; // steps of each
const TAIL = 600; // steps of the track that stay
const WRONG = "#d1492e";

async function unzip(text) {
  const zipped = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(zipped).arrayBuffer());
}

// A task's robot under network n.
class Live {
  static async load(told) {
    const image = await unzip(told.memory);
    const kernels = await Promise.all(told.kernels.map(async (text) => WebAssembly.compile(await unzip(text))));
    const robots = Object.entries(told.tasks).map(async ([name, facts]) => {
      const memory = new WebAssembly.Memory({ initial: Math.ceil((told.base + image.length) / 65536) });
      const parts = facts.kernels.map((one) => WebAssembly.instantiate(kernels[one], { env: { __linear_memory: memory } }));
      const exports = Object.assign({}, ...(await Promise.all(parts)).map((one) => one.exports));
      new Uint8Array(memory.buffer).set(image, told.base);
      return [name, new Live(facts, exports, memory.buffer)];
    });
    return Object.fromEntries(await Promise.all(robots));
  }

  constructor(facts, exports, buffer) {
    Object.assign(this, facts, { exports, buffer });
    const see = (name, Kind, many) => new Kind(buffer, facts.where[name], many);
    this.call = see("n", BigUint64Array, 4); // network, stream, step, how many steps
    this.level = see("world.level", Float64Array, 1);
    this.from = see("scratch.start", Float64Array, 3);
    this.place = see("scratch.state.pose", Float64Array, 3);
    this.readings = see("scratch.readings", Float64Array, facts.sensors);
    this.inputs = see("scratch.state.inputs", Int32Array, facts.inputs);
    this.outputs = see("scratch.state.outputs", Int32Array, 5 * facts.neurons);
    this.sizes = see("nets.neurons", BigInt64Array, facts.runs.length);
    this.path = ["path.x", "path.y", "path.contact"].map((name) => see(name, Float64Array, facts.steps));
    this.state = see("scratch.state.pose", Uint8Array, facts.at - facts.where["scratch.state.pose"]);
  }

  choose(run) {
    this.call[0] = BigInt(this.runs.indexOf(run));
  }

  start(seed) {
    this.call.set([BigInt(seed), 0n], 1);
    this.exports.start(this.at);
  }

  // At rest; says whether the body fits.
  stand({ x, y, heading }) {
    this.from.set([x, y, heading]);
    this.call[2] = 0n;
    this.exports.stand(this.at);
    return this.path[2][0] === 0;
  }

  step(many = 1) {
    this.call[3] = BigInt(many);
    this.exports.step(this.at);
    this.call[2] += BigInt(many);
  }

  get pose() {
    const [x, y, heading] = this.place;
    return { x, y, heading };
  }

  // What the last step read and commanded, and what its network put out.
  get inside() {
    const neurons = Number(this.sizes[Number(this.call[0])]);
    const outputs = [...this.outputs.slice(4 * neurons, 5 * neurons)]; // the row of the last update
    return [[...this.readings], outputs.slice(0, 2), [...this.inputs, ...outputs]];
  }

  // What `look` finds; afterwards all is as it was.
  aside(look) {
    const [state, call] = [this.state.slice(), this.call.slice()];
    const found = look();
    this.state.set(state);
    this.call.set(call);
    return found;
  }

  // Courses from here on, each under noise of its own.
  futures() {
    const many = Math.min(AHEAD, this.steps);
    const future = (t) => {
      this.call[1] = BigInt(t + 1) << 32n;
      this.step(many);
      return [this.path[0].slice(0, many), this.path[1].slice(0, many)];
    };
    return Array.from({ length: MANY }, (_, t) => this.aside(() => future(t)));
  }
}

function openDrive() {
  const source = byId("drive-data");
  if (!source) return;
  const data = JSON.parse(byId("player-data").textContent);
  const [root, deck, canvas] = ["player", "player-deck", "player-arena-0"].map(byId);
  const [open, noise, play, lost] = ["open", "noise", "play", "lost"].map((name) => byId(`drive-${name}`));
  const lists = ["task", "noise", "run"].map((name) => byId(`player-${name}`));
  let robots = null;
  let shown = null; // what is chosen, and what shows it
  let seed = 1;
  let frame = 0;
  let now = null; // a drive: its track so far, what is inside, what is held; null while recorded ones are shown

  function say(words) {
    lost.textContent = words;
    lost.hidden = !words;
  }

  async function enter() {
    try {
      robots ??= await Live.load(JSON.parse(source.textContent));
    } catch (error) {
      return say(`This browser does not run the simulation (${error.message}): the recorded drives remain.`);
    }
    if (byId("player-play").classList.contains("on")) byId("player-play").click();
    choose();
  }

  function choose(pose = null) {
    const [t, n, r] = lists.map((list) => list.selectedIndex);
    const task = data.tasks[t];
    const { runs, colour } = task.noises[n];
    const [run, live] = [runs[r], robots[task.name]];
    say(live ? "" : "Trials of this task draw a robot's constants anew: it cannot be driven here.");
    if (!live) return leave();
    root.classList.add("driving");
    live.choose(run.link);
    live.level[0] = Number(noise.value);
    const tracks = run.trials.filter((one) => one.driven).map((one) => openTrack(one.driven, task.unit_cm));
    shown = { task, live, tracks: tracks.filter((one) => one.pose(0)), colour, inside: makeInside(0, task, run, data.robot) };
    root.style.setProperty("--noise", colour);
    begin(pose);
    document.dispatchEvent(new CustomEvent("drivechoice", { detail: { live, task, run, again: () => choose(now.track.at(-1)) } }));
  }

  function leave() {
    root.classList.remove("driving");
    now = null;
    lists[2].dispatchEvent(new Event("change")); // the recorded drives, as they were
    open.textContent = "Drive it yourself";
  }

  // From a pose, or from a start of the task's own.
  function begin(pose = null) {
    const { live, tracks } = shown;
    live.start(seed);
    if (pose) live.stand(pose);
    const from = live.pose;
    const apart = (one) => Math.hypot(one.pose(0).x - from.x, one.pose(0).y - from.y);
    const [ghost] = tracks.sort((a, b) => apart(a) - apart(b));
    now = { track: [from], due: 0, playing: now ? now.playing : !still.matches, held: null, fan: [], ghost, own: pose };
    open.textContent = "Watch them drive";
    byId("drive-ghost").textContent = ghost ? `Faint: the ${ghost.who}, from its start nearest to this one.` : "";
    rest();
  }

  // What the sensors read here; what may follow.
  function look() {
    now.inside = shown.live.aside(() => (shown.live.step(), shown.live.inside));
    now.fan = now.held?.bad ? [] : shown.live.futures();
  }

  function rest(playing = now.playing) {
    Object.assign(now, { playing, before: performance.now() });
    play.textContent = playing ? "Pause" : "Play";
    if (!playing || !now.inside) look();
    if (playing) now.fan = [];
    show();
    cancelAnimationFrame(frame);
    frame = requestAnimationFrame(tick);
  }

  function tick(time) {
    if (!now?.playing || now.held) return;
    for (now.due += stepsGone(now, time, data.step_s); now.due >= 1; now.due--) {
      shown.live.step();
      now.track.push(shown.live.pose);
      now.inside = shown.live.inside;
      if (now.track.length > TAIL) now.track.shift();
    }
    show();
    frame = requestAnimationFrame(tick);
  }

  function show() {
    if (!now) return;
    const { task, live, colour } = shown;
    const { held, inside, fan, track, ghost } = now;
    const paint = colours();
    const tail = { steps: track.length - 1, pose: (k) => track[k] };
    const share = now.playing && !still.matches ? now.due - 1 : 0; // a step behind, so that it is between two
    const at = Math.max(0, tail.steps + share);
    const pose = held ?? poseBetween(tail, at);
    const dress = { colour, width: 1.1, alpha: 1, dash: [], body: held?.bad ? WRONG : paint.body };
    const under = (stage) => drawFan(stage, fan, pose, colour);
    const moment = { pose, readings: inside[0], course: ghost, tail: held ? null : tail, at, under };
    now.stage = drawMoment(canvas, task, data.robot, dress, moment, paint);
    shown.inside(...inside);
    byId("player-who-0").textContent = "yours to drive";
    byId("player-score-0").textContent = held?.bad ? "no room here" : `${(Number(live.call[2]) * data.step_s).toFixed(1)} s, seed ${seed}`;
    canvas.setAttribute("aria-label", `Your robot at ${written(pose.x)}, ${written(pose.y)} cm${held?.bad ? ": no room" : ""}`);
  }

  // Holds the robot at a pose, and shows what would follow.
  function hold(pose) {
    now.held = { ...now.held, ...pose, bad: !shown.live.stand(pose) };
    look();
    show();
  }

  function drop() {
    const { held, track } = now;
    clearTimeout(now.timer);
    begin(held.bad ? track.at(-1) : held);
    byId("player-said").textContent = canvas.getAttribute("aria-label");
  }

  // Moves it by so much, and lets go of it if nothing follows.
  function nudge(x, y, turn) {
    const at = now.held ?? now.track.at(-1);
    clearTimeout(now.timer);
    hold({ x: at.x + x, y: at.y + y, heading: at.heading + turn });
    if (at.id === undefined) now.timer = setTimeout(() => now?.held && drop(), 700);
  }

  function spot(event) {
    const box = canvas.getBoundingClientRect();
    const { scale, x, y } = now.stage;
    return { x: (event.clientX - box.left - x(0)) / scale, y: (y(0) - (event.clientY - box.top)) / scale };
  }

  function drag(event) {
    if (now?.held?.id === undefined) return;
    const [at, { x, y, id, off, heading }] = [spot(event), now.held];
    // The pointer moves it; with shift, and of a second finger, it looks at the pointer.
    if (event.shiftKey || event.pointerId !== id) hold({ x, y, heading: Math.atan2(at.y - y, at.x - x) });
    else hold({ x: at.x + off.x, y: at.y + off.y, heading });
  }

  root.addEventListener("click", (event) => now && deck.contains(event.target) && event.stopPropagation(), true);
  canvas.addEventListener("pointerdown", (event) => {
    if (!now) return;
    canvas.setPointerCapture(event.pointerId);
    clearTimeout(now.timer);
    const [at, is] = [spot(event), now.track.at(-1)];
    const near = Math.hypot(at.x - is.x, at.y - is.y) < 1.3 * data.robot.radius || event.shiftKey;
    const off = near ? { x: is.x - at.x, y: is.y - at.y } : { x: 0, y: 0 };
    if (now.held?.id === undefined) now.held = { ...is, id: event.pointerId, off };
    drag(event);
  });
  canvas.addEventListener("pointermove", drag);
  for (const name of ["pointerup", "pointercancel"])
    canvas.addEventListener(name, (event) => now?.held?.id === event.pointerId && drop());
  const wheel = (event) => now && (event.preventDefault(), nudge(0, 0, event.deltaY * 0.003));
  canvas.addEventListener("wheel", wheel, { passive: false });
  const KEYS = { ArrowLeft: [-1, 0, 1], ArrowRight: [1, 0, -1], ArrowUp: [0, 1, 0], ArrowDown: [0, -1, 0] };
  const pressed = (event) => {
    if (!now) return;
    event.stopImmediatePropagation(); // the recorded drives stay where they are
    const free = event.target === document.body || event.target === deck;
    if (!free || event.ctrlKey || event.altKey || event.metaKey) return;
    const [x, y, turn] = KEYS[event.key] ?? [];
    if (event.key === " ") rest(!now.playing);
    else if (x === undefined) return;
    else if (event.shiftKey) nudge(0, 0, (turn * Math.PI) / 36);
    else nudge(x, y, 0);
    event.preventDefault();
  };
  document.addEventListener("keydown", pressed, true);
  open.addEventListener("click", () => (now ? leave() : enter()));
  play.addEventListener("click", () => rest(!now.playing));
  byId("drive-new").addEventListener("click", () => {
    seed++;
    begin();
  });
  byId("drive-again").addEventListener("click", () => begin(now.own));
  noise.addEventListener("input", () => {
    byId("drive-level").textContent = Number(noise.value).toFixed(1);
    shown.live.level[0] = Number(noise.value);
    if (!now.playing) rest();
  });
  for (const list of lists) list.addEventListener("change", () => now && choose(list === lists[0] ? null : now.own));
  for (const name of ["rays", "tails"]) byId(`player-${name}`).addEventListener("change", show);
  window.addEventListener("resize", show);
  window.addEventListener("hashchange", () => now && choose());
  document.addEventListener("themechange", show);
  open.hidden = false;
  if (source.dataset.open) enter();
}

function drawFan(stage, courses, pose, colour) {
  const { pen, x, y } = stage;
  pen.strokeStyle = pen.fillStyle = colour;
  for (const [xs, ys] of courses) {
    pen.globalAlpha = 0.4;
    pen.lineWidth = 1.2;
    pen.beginPath();
    pen.moveTo(x(pose.x), y(pose.y));
    xs.forEach((cm, k) => pen.lineTo(x(cm), y(ys[k])));
    pen.stroke();
    pen.globalAlpha = 0.9;
    pen.beginPath();
    pen.arc(x(xs.at(-1)), y(ys.at(-1)), 2.2, 0, 2 * Math.PI);
    pen.fill();
  }
  pen.globalAlpha = 1;
}

openDrive();
