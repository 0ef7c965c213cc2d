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
