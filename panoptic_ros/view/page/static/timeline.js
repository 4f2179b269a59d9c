// The time line: who is there when, where ids begin and end, what is loaded, and where we are.

import { cssOf } from "#view/colors.js";
import { clockText } from "#view/player.js";

const TOP = 8, BOTTOM = 15, HIGHEST_LANE = 9, MOST_LANES = 10; // px

export class TimeLine {
  // flat: settings of 2D contexts. seek: called with a time.
  constructor(canvas, tip, flat, seek) {
    this.canvas = canvas;
    this.flat = flat;
    this.tip = tip;
    this.seek = seek;
    this.spans = [];
    this.lanes = [];
    this.begin = 0;
    this.end = 1;
    canvas.onpointerdown = (event) => { canvas.setPointerCapture(event.pointerId); this._go(event); };
    canvas.onpointermove = (event) => { this._hint(event); if (event.buttons) this._go(event); };
    canvas.onpointerleave = () => { tip.hidden = true; };
  }

  // spans: [id, first, last] in s from the beginning
  setSpans(spans) {
    this.spans = spans;
    this.lanes = arrange(spans);
  }

  // begin, end, t in ns; loaded: [[begin, end], ...]
  draw(begin, end, t, loaded) {
    [this.begin, this.end] = [begin, Math.max(end, begin + 1)];
    const { canvas } = this, dpr = Math.min(2, window.devicePixelRatio);
    const [w, h] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(w * dpr) || canvas.height !== Math.round(h * dpr)) [canvas.width, canvas.height] = [Math.round(w * dpr), Math.round(h * dpr)];
    const c = canvas.getContext("2d", this.flat);
    c.setTransform(dpr, 0, 0, dpr, 0, 0);
    c.clearRect(0, 0, w, h);
    this._ground(c, w, h, loaded);
    this._people(c, w, h);
    const x = this._x(t, w);
    c.fillStyle = "#fff";
    c.fillRect(x - 1, 0, 2, h);
    c.beginPath();
    c.moveTo(x - 5, 0);
    c.lineTo(x + 5, 0);
    c.lineTo(x, 6);
    c.fill();
  }

  _ground(c, w, h, loaded) {
    c.fillStyle = "#10151c";
    c.fillRect(0, 0, w, h);
    c.fillStyle = "#1a212b";
    for (const [a, b] of loaded) c.fillRect(this._x(a, w), 0, Math.max(1, this._x(b, w) - this._x(a, w)), h);
    const step = niceStep((this.end - this.begin) / 1e9 / Math.max(2, w / 90));
    c.font = "10px system-ui, sans-serif";
    c.textAlign = "left";
    for (let s = 0; s * 1e9 <= this.end - this.begin; s += step) {
      const x = this._x(this.begin + s * 1e9, w);
      c.fillStyle = "#2b3543";
      c.fillRect(x, 0, 1, h);
      c.fillStyle = "#71809a";
      c.fillText(clockText(s * 1e9).replace(/\.00$/, ""), x + 3, h - 4);
    }
  }

  _people(c, w, h) {
    const count = Math.min(MOST_LANES, Math.max(1, ...this.lanes.map((lane) => lane + 1)));
    const pitch = Math.min(HIGHEST_LANE + 2, (h - TOP - BOTTOM) / count), high = Math.max(1.5, pitch - (pitch > 5 ? 2 : 1));
    this.spans.forEach(([id, first, last], i) => {
      const y = TOP + (this.lanes[i] % MOST_LANES) * pitch;
      const x = this._x(this.begin + first * 1e9, w), wide = Math.max(2, this._x(this.begin + last * 1e9, w) - x);
      c.fillStyle = cssOf(id, 0.55);
      c.fillRect(x, y, wide, high);
      c.fillStyle = cssOf(id);
      c.fillRect(x, y - 0.5, 2, high + 1); // an id begins
      c.fillRect(x + wide - 2, y - 0.5, 2, high + 1); // and ends
      if (wide > 30 && high >= 8) {
        c.font = "600 9px system-ui, sans-serif";
        c.fillStyle = "#fff";
        c.fillText(`id ${id}`, x + 5, y + high - 1);
      }
    });
  }

  _x(t, w) {
    return ((t - this.begin) / (this.end - this.begin)) * w;
  }

  _time(event) {
    return this.begin + (event.offsetX / this.canvas.clientWidth) * (this.end - this.begin);
  }

  _go(event) {
    this.seek(this._time(event));
  }

  _hint(event) {
    const t = this._time(event), s = (t - this.begin) / 1e9;
    const there = this.spans.filter(([, first, last]) => s >= first && s <= last).map(([id]) => id);
    this.tip.hidden = false;
    this.tip.textContent = `${clockText(t - this.begin)}${there.length ? `   id ${[...new Set(there)].join(", ")}` : ""}`;
    this.tip.style.left = `${Math.min(event.offsetX, this.canvas.clientWidth - 120)}px`;
  }
}

// A lane for each span, so that those of one time lie below each other.
export function arrange(spans) {
  const ends = [];
  return spans.map(([, first, last]) => {
    let lane = ends.findIndex((end) => end < first);
    if (lane < 0) lane = ends.length;
    ends[lane] = last;
    return lane;
  });
}

// A round number of seconds that is at least `least`.
export function niceStep(least) {
  const steps = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200];
  return steps.find((step) => step >= least) ?? 14400;
}
