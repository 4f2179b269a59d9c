// The time that is shown, in nanoseconds since the origin of the scene.

const SECOND = 1e9;
export const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8];

export class Player {
  // begin, end: of a recording; a live scene has none and follows the newest instant.
  constructor(live, begin = 0, end = 0) {
    this.live = live;
    this.begin = begin;
    this.end = end;
    this.t = begin;
    this.playing = live;
    this.speed = 1;
    this.sought = true; // a time that is to be gone to; who sees to it says false
  }

  get following() {
    return this.live && this.playing;
  }

  toggle() {
    this.playing = !this.playing;
    if (this.playing && !this.live && this.t >= this.end) this.t = this.begin;
  }

  seek(t) {
    this.t = Math.min(Math.max(t, this.begin), this.end);
    this.sought = true;
    if (this.live) this.playing = false;
  }

  faster(steps) {
    const i = SPEEDS.indexOf(this.speed) + steps;
    this.speed = SPEEDS[Math.min(Math.max(0, i), SPEEDS.length - 1)];
  }

  // Go on by so many milliseconds of real time; `ready` tells whether there is data for a time.
  advance(ms, ready) {
    if (this.live || !this.playing) return;
    const t = Math.min(this.t + ms * 1e6 * this.speed, this.end);
    if (!ready(t)) return;
    this.t = t;
    if (t >= this.end) this.playing = false;
  }
}

// "1:02:03.45" of nanoseconds
export function clockText(t) {
  const s = Math.max(0, t) / SECOND, hours = Math.floor(s / 3600), minutes = Math.floor(s / 60) % 60;
  const rest = (s % 60).toFixed(2).padStart(5, "0");
  return hours ? `${hours}:${String(minutes).padStart(2, "0")}:${rest}` : `${minutes}:${rest}`;
}
