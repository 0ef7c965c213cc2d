// Evolve by hand: the twelve numbers of the network "yours" on sliders, and its fitness beside the evolved one's.
const TRIALS = 20;
const [HAND, EVOLVED] = ["yours", "evolved"];
const SENSORS = 5;

// The mean fitness of some trials of a network, each from a start and under noise of its own.
function fitness(live, name, before) {
  const score = new Float64Array(live.buffer, live.scored, 1);
  return live.aside(() => {
    let sum = 0;
    live.choose(name);
    for (let seed = 1; seed <= TRIALS; seed++) {
      live.start(1000 + seed);
      live.step(live.steps);
      live.exports.score(live.scored);
      sum += score[0];
    }
    live.choose(before);
    return sum / TRIALS;
  });
}

// A network's numbers in the page's memory: of each wheel the threshold, then a weight for each sensor.
function numbersOf(live, name) {
  const n = live.runs.indexOf(name);
  const see = (where, many) => new Int16Array(live.buffer, live.where[where], many * live.runs.length).subarray(n * many);
  const [thresholds, links] = [see("nets.thresholds", live.neurons), see("nets.sensor_links", 4 * live.links)];
  return Array.from({ length: 2 + 2 * SENSORS }, (_, i) => {
    const [wheel, at] = [Math.floor(i / (SENSORS + 1)), i % (SENSORS + 1)];
    const [array, place] = at ? [links, 4 * (wheel * SENSORS + at - 1) + 2] : [thresholds, wheel];
    return { get: () => array[place], set: (value) => (array[place] = value), wheel, sensor: at - 1 };
  });
}

byId("player-deck").after(document.querySelector(".by-hand"));
let judge = () => {};
byId("drive-noise").addEventListener("input", () => judge());
document.addEventListener("drivechoice", ({ detail: { live, task, run, again } }) => {
  const box = byId("by-hand");
  const mine = numbersOf(live, HAND);
  judge = () => {
    for (const name of [HAND, EVOLVED]) byId(`fitness-${name}`).textContent = fitness(live, name, run.link).toFixed(3);
  };
  const restart = () => {
    byId("player-run").selectedIndex = 0; // yours
    again();
  };
  const bend = (number, value) => {
    number.set(value);
    const drawn = task.noises[0].runs[0].network; // yours
    if (number.sensor < 0) drawn.neurons[SENSORS + number.wheel].threshold = value;
    else {
      const link = drawn.links.find((one) => one.to === SENSORS + number.wheel && one.from === number.sensor);
      Object.assign(link, { weight: value, works: value !== 0 });
      drawn.neurons[link.from].useful = drawn.links.some((one) => one.from === link.from && one.works);
    }
  };
  const fill = () => {
    box.replaceChildren();
    mine.forEach((number) => {
      const group = number.sensor < 0 ? made("fieldset", {}, box) : box.lastChild;
      if (number.sensor < 0) made("legend", {}, group, `${["Left", "Right"][number.wheel]} wheel`);
      const most = number.sensor < 0 ? 10 : 4;
      const label = made("label", {}, group, number.sensor < 0 ? "threshold" : `eye ${number.sensor}`);
      const range = { type: "range", min: -most, max: most, step: 1 };
      const [slider, value] = [made("input", range, label), made("b", {}, label, written(number.get()))];
      slider.value = number.get();
      slider.addEventListener("input", () => {
        bend(number, Number(slider.value));
        value.textContent = written(number.get());
        restart();
      });
    });
  };
  byId("by-hand-copy").onclick = () => {
    numbersOf(live, EVOLVED).forEach((number, i) => bend(mine[i], number.get()));
    restart();
  };
  byId("by-hand-none").onclick = () => {
    mine.forEach((number) => bend(number, 0));
    restart();
  };
  if (!box.contains(document.activeElement)) fill();
  judge();
});
