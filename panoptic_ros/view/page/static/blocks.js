// Seconds of a recording: which are there, which are on their way, and which are asked for next.

const SECOND = 1e9;
const BEFORE = 2, BEHIND = 6; // that are kept around the one that is shown
const AHEAD = 3; // that are asked for ahead
const TRAIL = 3; // that a picture shows of what was before
const UNDER_WAY = 2; // at most, so that a second that is wanted next waits for no others
const FAR = 4; // that are kept beside

export class Blocks {
  // end: of the recording, ns since its beginning. ask: called with the number of a second.
  constructor(end, ask) {
    this.end = end;
    this.ask = ask;
    this.states = new Map(); // by number: "asked", "there", "failed"
  }

  // Ask for what the picture of a time needs, then for what comes next.
  load(t) {
    const now = numberOf(t), last = numberOf(this.end);
    let free = UNDER_WAY - this._count("asked");
    for (const k of [now, now - 1, ...Array.from({ length: AHEAD }, (_, i) => now + 1 + i)]) {
      if (free <= 0) return;
      if (k < 0 || k > last || this.states.has(k)) continue;
      this.states.set(k, "asked");
      free -= 1;
      this.ask(k);
    }
  }

  came(number) {
    this.states.set(number, "there");
  }

  failed(number) {
    this.states.set(number, "failed");
  }

  clear() {
    this.states.clear();
  }

  isThere(t) {
    return this.states.get(numberOf(t)) === "there";
  }

  // Whether nothing is on its way that the picture of a time needs: its second, and the one before for images and trails.
  isWhole(t) {
    const settled = (k) => k < 0 || ["there", "failed"].includes(this.states.get(k));
    return settled(numberOf(t)) && settled(numberOf(t) - 1);
  }

  // Whether the picture of a time is another one with this second.
  matters(number, t) {
    return number <= numberOf(t) && number >= numberOf(t) - TRAIL;
  }

  // Spans that are there, ns.
  get loaded() {
    const there = [...this.states].filter(([, state]) => state === "there");
    return there.map(([k]) => [k * SECOND, Math.min((k + 1) * SECOND, this.end)]);
  }

  // Forget seconds that are far away; the span that is kept, ns, if there were enough of them, else null.
  forgetFar(t) {
    const first = numberOf(t) - BEFORE, behind = numberOf(t) + BEHIND;
    const far = [...this.states].filter(([k, state]) => (k < first || k > behind) && state !== "asked");
    if (far.length <= FAR) return null;
    for (const [k] of far) this.states.delete(k);
    return [first * SECOND, (behind + 1) * SECOND];
  }

  _count(wanted) {
    return [...this.states.values()].filter((state) => state === wanted).length;
  }
}

function numberOf(t) {
  return Math.floor(t / SECOND);
}
