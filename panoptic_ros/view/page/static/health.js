// How cameras, stages and this page are: from the server (live) or the report of a run (recorded).

import { escape } from "#view/inspector.js";

const SILENT_S = 1;

// {camera: {rate, age, dropped, clock}}, [{stage, p50, p99}], drops and warnings of what a live graph says of
// itself; docs/ros.md lists the names of statuses
export function fromHealth(health) {
  const cameras = {}, stages = [];
  for (const [name, { rate_hz, age_s }] of Object.entries(health.cameras)) {
    cameras[name] = { rate: rate_hz, age: age_s, dropped: 0, clock: null };
  }
  for (const { name: what, owner, values } of health.statuses) {
    const clock = what.match(/clock of (.*)$/)?.[1];
    if (clock && cameras[clock]) cameras[clock].clock = `${(1000 * Number(values.offset_s)).toFixed(2)} ms ± ${Number(values.std_us).toFixed(0)} µs`;
    const input = what.includes(": ");
    if (!input && values.step_p50_ms !== undefined && Number(values.taken) > 0) {
      stages.push({ stage: what, p50: Number(values.step_p50_ms), p99: Number(values.step_p99_ms) });
    }
    const camera = cameras[owner] ?? cameras[what.replace(/^camera_/, "")];
    if (camera) camera.dropped += input ? lostOf(values) : droppedOf(values);
  }
  return { cameras, stages, dropped: causes(health.statuses), warnings: health.statuses.filter(({ level }) => level > 0).map(({ name, message }) => [name, message]) };
}

// [["stage: cause", how many]]
function causes(statuses) {
  return statuses.flatMap(({ name, values }) => Object.entries(values)
    .filter(([key, n]) => key.startsWith("dropped.") && Number(n))
    .map(([key, n]) => [`${name}: ${key.slice(8)}`, Number(n)]));
}

function lostOf(values) {
  return ["lost", "left_out", "bad"].reduce((sum, key) => sum + (Number(values[key]) || 0), 0);
}

function droppedOf(values) {
  return Object.entries(values).filter(([key]) => key.startsWith("dropped.")).reduce((sum, [, n]) => sum + (Number(n) || 0), 0);
}

// The same of report.json, and the rates at a time
export function fromReport({ report, rates }, names, store, t) {
  const cameras = {};
  for (const name of names) cameras[name] = { rate: rates?.[name] ?? store.rateAt(name, t), age: null, dropped: null, clock: null, frames: report.frames?.in?.[name] };
  const stages = Object.entries(report.latency_ms ?? {}).map(([stage, { p50, p99 }]) => ({ stage, p50, p99 }));
  return { cameras, stages, dropped: Object.entries(report.frames?.dropped ?? {}).filter(([, n]) => n), warnings: (report.notices ?? []).map(({ code, text }) => [code, text]) };
}

// What stands over a camera's picture: [parts, tone]
export function captionOf(camera, live) {
  if (!camera) return [[], ""];
  const parts = [`${camera.rate < 9.95 ? camera.rate.toFixed(1) : camera.rate.toFixed(0)} Hz`];
  const silent = live && (camera.age === null || camera.age > SILENT_S);
  if (silent) parts.push(camera.age === null ? "nothing yet" : `silent ${camera.age.toFixed(0)} s`);
  if (camera.dropped) parts.push(`${camera.dropped} dropped`);
  return [parts, silent ? "bad" : camera.dropped ? "warn" : "good"];
}

export class HealthPanel {
  constructor(element) {
    this.element = element;
    this.shown = "";
  }

  draw({ cameras, stages, dropped, warnings }, extra) {
    const most = Math.max(1, ...stages.map(({ p99 }) => p99));
    const bars = stages.map(({ stage, p50, p99 }) => `<tr><td>${escape(stage)}</td><td class="bar"><i style="width:${(100 * p99) / most}%"></i><b style="width:${(100 * p50) / most}%"></b></td><td>${number(p50)}</td><td>${number(p99)}</td></tr>`);
    const rows = Object.entries(cameras).map(([name, c]) => `<tr><td>${escape(name)}</td><td>${c.rate.toFixed(1)}</td><td>${c.age === null ? c.frames ?? "–" : c.age.toFixed(2)}</td><td>${c.dropped ?? "–"}</td><td>${c.clock ?? "–"}</td></tr>`);
    const live = Object.values(cameras).some((c) => c.age !== null);
    const html = `${extra.map(([name, value]) => `<div class="fact"><span>${escape(name)}</span><b>${escape(value)}</b></div>`).join("")}
      ${warnings.length ? `<h3>Notices</h3>${warnings.map(([name, text]) => `<p class="notice"><b>${escape(name)}</b> ${escape(text)}</p>`).join("")}` : ""}
      <h3>Cameras</h3><table><thead><tr><th>camera</th><th>Hz</th><th>${live ? "age s" : "images"}</th><th>dropped</th><th>clock</th></tr></thead><tbody>${rows.join("")}</tbody></table>
      ${bars.length ? `<h3>Time per stage, ms</h3><table class="stages"><thead><tr><th>stage</th><th></th><th>p50</th><th>p99</th></tr></thead><tbody>${bars.join("")}</tbody></table>` : ""}
      ${dropped.length ? `<h3>Dropped</h3><table><tbody>${dropped.map(([name, n]) => `<tr><td>${escape(name)}</td><td>${n}</td></tr>`).join("")}</tbody></table>` : ""}`;
    if (html !== this.shown) this.element.innerHTML = this.shown = html;
  }
}

function number(x) {
  return x >= 99.95 ? x.toFixed(0) : x.toFixed(1);
}
