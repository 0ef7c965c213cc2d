// Whole trials by a page's module: the digest of all bits of their paths, trial by trial. Runs in node and in browsers.
async function digests(module, image, { base, cases, streams }) {
  const found = [];
  for (const { at, where, steps, level, nudge } of cases) {
    const memory = new WebAssembly.Memory({ initial: Math.ceil((base + image.length) / 65536) });
    const { exports } = await WebAssembly.instantiate(module, { env: { __linear_memory: memory } });
    new Uint8Array(memory.buffer).set(image, base);
    new Float64Array(memory.buffer, where["world.level"], 1)[0] = level;
    if (nudge) new BigUint64Array(memory.buffer, where[nudge], 1)[0] += 1n; // one unit in the last place
    const [n, stream, many] = ["n", "stream", "many"].map((name) => new BigUint64Array(memory.buffer, where[name], 1));
    const all = new Uint8Array(streams.length * 48 * steps);
    streams.forEach((text, t) => {
      n[0] = BigInt(t);
      stream[0] = BigInt(text);
      many[0] = BigInt(steps);
      exports.start(at);
      exports.step(at);
      ["x", "y", "heading", "left", "right", "contact"].forEach((row, i) => {
        const path = new Uint8Array(memory.buffer, where["path." + row], 8 * steps);
        all.set(path, 8 * steps * (6 * t + i));
      });
    });
    const hash = new Uint8Array(await crypto.subtle.digest("SHA-256", all));
    found.push([...hash].map((byte) => byte.toString(16).padStart(2, "0")).join(""));
  }
  return found;
}
const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
async function check(told) {
  const module = await WebAssembly.compile(bytesOf(told.kernel));
  const imports = WebAssembly.Module.imports(module).map((one) => one.name);
  return { imports, found: await digests(module, bytesOf(told.memory), told) };
}
