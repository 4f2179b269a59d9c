// What has come, by stamps: skeletons, 2D people, previews, and whatever layers show besides.
// Times are nanoseconds since the origin of the scene, as Numbers.

import { Decoder } from "#view/cdr.js";

const SECOND = 1e9;
const REACH = 2 * SECOND; // how far back a tile looks for an image
const NEAR = 0.025 * SECOND; // 2D people of an instant that does not name its frames

export class Store {
  constructor(facts) {
    this.decoder = new Decoder(facts.schemas);
    this.topics = facts.topics;
    this.origin = facts.kind === "live" ? null : BigInt(facts.begin_ns);
    this.instants = []; // {t, people, frames}, sorted
    this.views = new Map(); // by camera: {byFrame, byTime, times, run, last, shift}, see _addView
    this.previews = new Map(); // by camera: {byTime, times}
    this.others = new Map(); // by key: [{t, message}], sorted
    this.problems = 0;
  }

  add({ topic, bytes }) {
    const [key, owner, type] = this.topics[topic];
    const t = this.timeOf(bytes);
    try {
      if (key === "preview") this._addPreview(owner, t, bytes, type);
      else if (key === "detections") this._addView(owner, t, this.decoder.decode(bytes, type));
      else if (key === "skeletons") this._addInstant(t, this.decoder.decode(bytes, type));
      else insert(this.others.get(key) ?? this._newList(key), { t, message: this.decoder.decode(bytes, type) });
    } catch (error) {
      this.problems += 1;
    }
    return t;
  }

  // Forget all that is older (live), or outside of a span (recorded).
  forget(begin, end = Infinity) {
    const inside = (t) => t >= begin && t < end;
    this.instants = this.instants.filter((item) => inside(item.t));
    for (const kept of this.previews.values()) keepTimes(kept, inside, closeImage);
    for (const kept of this.views.values()) {
      for (const [frame, views] of kept.byFrame) {
        const left = views.filter((view) => inside(view.t));
        if (left.length) kept.byFrame.set(frame, left);
        else kept.byFrame.delete(frame);
      }
      keepTimes(kept, inside);
    }
    for (const [key, list] of this.others) this.others.set(key, list.filter((item) => inside(item.t)));
  }

  get newest() {
    return this.instants.length ? this.instants[this.instants.length - 1] : null;
  }

  // The time of the newest instant; of the newest image if that is more than `patience` newer; null without both.
  front(patience) {
    const images = [...this.previews.values()].map((kept) => kept.times.at(-1)).filter((t) => t !== undefined);
    const image = images.length ? Math.max(...images) : null, instant = this.newest?.t ?? null;
    if (instant === null || (image !== null && image - instant > patience)) return image ?? instant;
    return instant;
  }

  // The preview that a message has brought, null if it was another one.
  previewOf({ topic }, t) {
    const [key, owner] = this.topics[topic];
    return key === "preview" ? this.previews.get(owner)?.byTime.get(t) ?? null : null;
  }

  // The instant at or before a time, null if there is none.
  instantAt(t) {
    const i = upper(this.instants, t) - 1;
    return i >= 0 ? this.instants[i] : null;
  }

  // The instant `step` places on from a time.
  stepFrom(t, step) {
    const i = step > 0 ? upper(this.instants, t) + step - 1 : upper(this.instants, t - 1) + step;
    return this.instants[Math.min(Math.max(0, i), this.instants.length - 1)] ?? null;
  }

  // The same of images, where there are no instants: {t}.
  imageFrom(t, step) {
    const times = [...new Set([...this.previews.values()].flatMap((kept) => kept.times))].sort((a, b) => a - b);
    const i = step > 0 ? upper(times, t, (x) => x) + step - 1 : upper(times, t - 1, (x) => x) + step;
    return times.length ? { t: times[Math.min(Math.max(0, i), times.length - 1)] } : null;
  }

  between(begin, end) {
    return this.instants.slice(upper(this.instants, begin), upper(this.instants, end));
  }

  // The 2D people of a camera at an instant, null if they are not known.
  viewOf(camera, instant) {
    const kept = this.views.get(camera);
    if (!kept || !instant) return null;
    if (camera in instant.frames) return numbered(kept, instant.frames[camera], instant.t);
    if (Object.keys(instant.frames).length) return null;
    const t = nearest(kept.times, instant.t);
    return t !== null && Math.abs(t - instant.t) <= NEAR ? kept.byTime.get(t) : null;
  }

  // What a tile shows at a time: the newest image, with the people of its own stamp: {preview, view, instant}.
  // Of a camera without images the people alone. usable: whether an image can be shown.
  pairAt(camera, t, usable = () => true) {
    const previews = this.previews.get(camera);
    if (!previews) {
      const instant = this.instantAt(t), view = this.viewOf(camera, instant);
      return view && instant.t > t - REACH ? { preview: null, view, instant } : this._viewAlone(camera, t);
    }
    for (let i = upper(this.instants, t) - 1; i >= 0 && this.instants[i].t > t - REACH; i--) {
      const view = this.viewOf(camera, this.instants[i]);
      const preview = view && previews.byTime.get(view.t);
      if (preview && usable(preview)) return { preview, view, instant: this.instants[i] };
    }
    const last = upper(previews.times, t, (x) => x) - 1;
    if (last < 0 || previews.times[last] < t - REACH) return null;
    const preview = previews.byTime.get(previews.times[last]);
    if (!usable(preview)) return null;
    return { preview, view: this.views.get(camera)?.byTime.get(preview.t) ?? null, instant: null };
  }

  _viewAlone(camera, t) {
    const kept = this.views.get(camera), last = kept ? upper(kept.times, t, (x) => x) - 1 : -1;
    return last >= 0 && kept.times[last] > t - REACH ? { preview: null, view: kept.byTime.get(kept.times[last]), instant: null } : null;
  }

  // The newest message of a layer's topic at or before a time.
  otherAt(key, t, reach = REACH) {
    const list = this.others.get(key) ?? [];
    const item = list[upper(list, t) - 1];
    return item && item.t > t - reach ? item.message : null;
  }

  // Images per second of a camera around a time, by the steps between its 2D people.
  rateAt(camera, t) {
    return rate(this.views.get(camera)?.times ?? [], t, (x) => x);
  }

  // Instants per second around a time.
  instantRate(t) {
    return rate(this.instants, t, (item) => item.t);
  }

  // ns since the origin of a message that begins with a header
  timeOf(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const little = view.getUint8(1) !== 0;
    const stamp = BigInt(view.getInt32(4, little)) * 1000000000n + BigInt(view.getUint32(8, little));
    if (this.origin === null) this.origin = stamp;
    return Number(stamp - this.origin);
  }

  _addInstant(t, message) {
    const frames = {};
    message.view_cameras.forEach((camera, i) => { frames[camera] = message.view_frames[i]; });
    insert(this.instants, { t, frames, people: message.skeletons, cameras: message.view_cameras, index: message.index });
  }

  _addView(camera, t, message) {
    const none = { byFrame: new Map(), byTime: new Map(), times: [], run: 0, last: -1, shift: null };
    const kept = this.views.get(camera) ?? none, number = message.frame_number;
    this.views.set(camera, kept);
    if (number < kept.last) kept.run += 1; // a driver that was started anew counts from the beginning
    kept.last = number;
    const view = { t, camera, message, run: kept.run };
    const others = (kept.byFrame.get(number) ?? []).filter((other) => other.t !== t);
    kept.byFrame.set(number, [...others, view]);
    addTime(kept, t, view);
  }

  _addPreview(camera, t, bytes, type) {
    const kept = this.previews.get(camera) ?? { byTime: new Map(), times: [] };
    this.previews.set(camera, kept);
    addTime(kept, t, { t, camera, jpeg: this.decoder.decode(bytes, type).data, bitmap: null, asked: false });
  }

  _newList(key) {
    const list = [];
    this.others.set(key, list);
    return list;
  }
}

// The view with a number that is nearest to an instant, on the clock of its camera: `shift` from that of instants, as
// its first pair shows. Once a driver has counted anew the number alone does not tell which one is meant.
function numbered(kept, number, t) {
  const away = (view) => Math.abs(view.t - t - (kept.shift ?? 0));
  const view = (kept.byFrame.get(number) ?? []).reduce((a, b) => (a && away(a) <= away(b) ? a : b), null);
  if (view && kept.shift === null && view.run === kept.run) kept.shift = view.t - t;
  return view && (kept.run === 0 || away(view) <= REACH) ? view : null;
}

function addTime(kept, t, item) {
  if (!kept.byTime.has(t)) kept.times.splice(upper(kept.times, t, (x) => x), 0, t);
  kept.byTime.set(t, item);
}

function keepTimes(kept, inside, gone = () => {}) {
  for (const t of kept.times) {
    if (inside(t)) continue;
    gone(kept.byTime.get(t));
    kept.byTime.delete(t);
  }
  kept.times = kept.times.filter(inside);
}

function closeImage(preview) {
  preview.bitmap?.close?.();
  preview.bitmap = null; // a tile may still hold the preview
}

function insert(list, item) {
  const i = upper(list, item.t);
  if (i > 0 && list[i - 1].t === item.t) list[i - 1] = item;
  else list.splice(i, 0, item);
}

function rate(list, t, timeOf) {
  const near = list.slice(upper(list, t - SECOND, timeOf), upper(list, t + SECOND, timeOf)).map(timeOf);
  return near.length > 1 ? ((near.length - 1) * SECOND) / (near[near.length - 1] - near[0]) : 0;
}

// Index behind the last item at or before a time.
export function upper(list, t, timeOf = (item) => item.t) {
  let low = 0, high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (timeOf(list[middle]) <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}

function nearest(times, t) {
  const i = upper(times, t, (x) => x);
  const around = [times[i - 1], times[i]].filter((x) => x !== undefined);
  return around.length ? around.reduce((a, b) => (Math.abs(a - t) <= Math.abs(b - t) ? a : b)) : null;
}
