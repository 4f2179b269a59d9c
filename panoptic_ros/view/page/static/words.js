// What the page says in words and numbers: header, captions of tiles, clock, health.

import { captionOf, fromHealth, fromReport } from "#view/health.js";
import { clockText } from "#view/player.js";

const $ = (id) => document.getElementById(id);

export function drawWords(page, scene, tiles, healthPanel) {
  const { player, facts, health } = page, live = player.live;
  const found = live ? health && fromHealth(health) : fromReport(facts, [...page.cameras.keys()], page.store, player.t);
  for (const name of page.cameras.keys()) {
    const [parts, tone] = captionOf(found?.cameras[name], live);
    const pair = tiles.tiles.get(name)?.pair, lag = pair?.instant && scene.instant ? (scene.instant.t - pair.instant.t) / 1e6 : 0;
    if (lag > 0.5) parts.push(`image −${lag.toFixed(0)} ms`);
    tiles.caption(name, parts, tone);
  }
  const people = scene.instant?.people.length ?? 0;
  const said = [`<b>${people}</b> ${people === 1 ? "person" : "people"}`, `<b>${page.cameras.size}</b> cameras`];
  if (live && health) {
    said.push(`<b>${health.skeletons.rate_hz.toFixed(0)}</b> Hz`);
    if (health.latency_ms) said.push(`<b>${health.latency_ms[0].toFixed(0)}</b> ms`);
  } else if (!live) said.push(`<b>${page.store.instantRate(player.t).toFixed(0)}</b> Hz`);
  setHtml($("summary"), said.join(" · "));
  const silent = live && health && (health.skeletons.age_s === null || health.skeletons.age_s > 1);
  $("badge").className = `badge ${silent ? "bad" : player.following ? "live" : ""}`;
  $("badge").textContent = !live ? "recorded" : silent ? "NO SKELETONS" : player.following ? "● LIVE" : "paused";
  $("play").classList.toggle("playing", player.playing);
  $("speed").hidden = live;
  $("speed").value = String(player.speed);
  setHtml($("clock"), live ? clockText(player.t) : `${clockText(player.t)} <small>/ ${clockText(player.end)}</small>`);
  if (!$("health").hidden && found) healthPanel.draw(found, extraFacts(page, live, health));
}

function extraFacts(page, live, health) {
  const rows = [];
  if (live && health?.latency_ms) rows.push(["capture to here, p50 / p99", `${health.latency_ms.map((x) => x.toFixed(0)).join(" / ")} ms`]);
  if (live && health) rows.push(["instants that this page skipped", String(health.page.dropped)]);
  if (!live && page.facts.report.elapsed_s) rows.push(["run took", `${page.facts.report.elapsed_s} s`]);
  if (page.store.problems) rows.push(["messages that cannot be read", String(page.store.problems)]);
  return rows;
}

function setHtml(element, html) {
  if (element.dataset.html !== html) element.innerHTML = element.dataset.html = html;
}
