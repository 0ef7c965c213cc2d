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
