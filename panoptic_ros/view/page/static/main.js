// The page: what comes is put into the store, and drawn when something has changed.

import { makeCamera } from "#view/lens.js";
import { LAYERS } from "#view/layers.js";
import { Store } from "#view/store.js";
import { openSource } from "#view/source.js";
import { LIVE } from "#view/packets.js";
import { Player, SPEEDS } from "#view/player.js";
import { Stage3D } from "#view/stage3d.js";
import { Tiles } from "#view/tiles.js";
import { TimeLine } from "#view/timeline.js";
import { Inspector } from "#view/inspector.js";
import { HealthPanel } from "#view/health.js";
import { drawWords } from "#view/words.js";
import { exposeForTests } from "#view/for_tests.js";

const SECOND = 1e9;
const KEPT_LIVE_S = 20;
const PATIENCE_S = 1.5; // behind images, before skeletons count as missing
const AROUND = 2; // seconds of a recording that are kept before, and three times as many behind, the one that is shown
const AHEAD = 3; // seconds that are asked for ahead
const $ = (id) => document.getElementById(id);

const page = {
  facts: null, store: null, player: null, cameras: new Map(), pictures: new Map(), selected: null, health: null,
  spans: [], blocks: new Map(), // by number: "asked" or "there"
  shown: new Set(LAYERS.filter((layer) => layer.on).map((layer) => layer.name)),
  dirty: true, version: 0, undrawn: [], fitted: false, instant: null, drawn: 0,
};
const redraw = () => { page.dirty = true; page.version += 1; };
const stage = new Stage3D($("stage"), $("labels"), () => { page.dirty = true; });
const spaces = LAYERS.filter((layer) => layer.space).map((layer) => [layer, makeSpace(layer)]);
const tiles = new Tiles($("tiles"), { changed: () => { page.dirty = true; }, picked: select, looked: (camera) => { stage.lookThrough(camera); redraw(); } });
const line = new TimeLine($("timeline"), $("tip"), (t) => { page.player?.seek(t); redraw(); });
const inspector = new Inspector($("inspector"), select);
const healthPanel = new HealthPanel($("health"));

function makeSpace(layer) {
  const groups = [];
  const update = layer.space({ group: () => { groups.push(stage.group()); return groups.at(-1); }, frustumDepth: (cameras) => stage.frustumDepth(cameras) });
  return (scene) => {
    for (const group of groups) group.visible = page.shown.has(layer.name);
    if (page.shown.has(layer.name)) update(scene);
  };
}

// ------------------------------------------------------------------------------- what comes

const source = openSource({
  told(words) {
    if (words.type === "facts") begin(words);
    else if (words.type === "presence") { page.spans = words.spans; line.setSpans(words.spans); }
    else if (words.type === "health") page.health = words;
    else if (words.type === "waiting" || words.type === "problem") wait(words.text);
    redraw();
  },
  packet({ kind, number, messages }) {
    if (!page.store) return;
    if (kind === LIVE && goesBack(messages)) page.store = new Store(page.facts);
    for (const message of messages) {
      const preview = page.store.previewOf(message, page.store.add(message));
      if (preview && kind === LIVE) tiles.decode(preview); // while the rest is drawn
    }
    if (kind === LIVE) {
      page.undrawn.push(number);
      page.store.forget(page.store.front(PATIENCE_S * SECOND) - KEPT_LIVE_S * SECOND);
    } else page.blocks.set(number, "there");
    redraw();
  },
});

// Whether time has gone back, as where a bag is played again.
function goesBack(messages) {
  const front = page.store.front(PATIENCE_S * SECOND);
  return front !== null && messages.every((message) => page.store.timeOf(message.bytes) < front - PATIENCE_S * SECOND);
}

function begin(facts) {
  const live = facts.kind === "live";
  page.facts = facts;
  page.store = new Store(facts);
  page.player = new Player(live, 0, live ? 0 : Number(BigInt(facts.end_ns) - BigInt(facts.begin_ns)));
  page.cameras = new Map(facts.cameras.map((camera) => [camera.name, makeCamera(camera)]));
  page.blocks.clear();
  page.fitted = false;
  tiles.begin(page.cameras, facts.skeleton.bones);
  stage.fit(page.cameras, []);
  document.title = `${facts.title} – panoptic`;
  $("title").textContent = facts.title;
  showLayers();
  source.show(keys());
  wait(live ? "waiting for images and skeletons" : "reading");
}

function wait(text) {
  $("waiting").hidden = !text;
  $("waiting").firstElementChild.textContent = text ?? "";
}

function keys() {
  return LAYERS.filter((layer) => page.shown.has(layer.name)).flatMap((layer) => layer.keys);
}

// Ask for the seconds of a recording that are needed now, and forget those that are far away.
function load() {
  if (page.player.live) return;
  const now = Math.floor(page.player.t / SECOND), last = Math.floor(page.player.end / SECOND);
  const order = [now, now - 1, ...Array.from({ length: AHEAD }, (_, i) => now + 1 + i)]; // the one that is shown first
  for (const k of order) {
    if (k < 0 || k > last || page.blocks.has(k)) continue;
    page.blocks.set(k, "asked");
    source.ask(k, keys());
  }
  const first = now - AROUND, behind = now + 3 * AROUND;
  const far = [...page.blocks.keys()].filter((k) => (k < first || k > behind) && page.blocks.get(k) === "there");
  if (far.length > 4) {
    for (const k of far) page.blocks.delete(k);
    page.store.forget(first * SECOND, (behind + 1) * SECOND);
  }
}

const isLoaded = (t) => page.blocks.get(Math.floor(t / SECOND)) === "there";

// ------------------------------------------------------------------------------- drawing

let before = performance.now();

function frame(now) {
  requestAnimationFrame(frame);
  const elapsed = now - before;
  before = now;
  if (!page.facts) return;
  const { player } = page, t = player.t;
  load();
  player.advance(Math.min(elapsed, 250), isLoaded);
  if (player.following) followNewest();
  if (player.t !== t) redraw();
  if (!page.dirty) return;
  page.dirty = false;
  draw();
  for (const number of page.undrawn.splice(0)) source.drawn(number);
}

// Live, the newest instant; where nobody makes skeletons, the newest image.
function followNewest() {
  const t = page.store.front(PATIENCE_S * SECOND);
  if (t === null) return;
  page.player.begin = t - KEPT_LIVE_S * SECOND;
  page.player.t = page.player.end = t;
}

function draw() {
  const { store, player } = page;
  const scene = { facts: page.facts, cameras: page.cameras, store, t: player.t, instant: null, selected: page.selected, pictures: page.pictures, shows: (name) => page.shown.has(name) };
  scene.instant = page.instant = nearEnough(store.instantAt(player.t), player.t);
  const layers = LAYERS.filter((layer) => page.shown.has(layer.name));
  page.pictures = scene.pictures = tiles.draw(scene, layers, page.version);
  if (player.playing && !player.live) tiles.prepare([...page.cameras.keys()].map((name) => store.pairAt(name, player.t + 0.15 * SECOND)));
  if (!page.fitted && scene.instant?.people.length) { stage.fit(page.cameras, scene.instant.people); page.fitted = true; }
  for (const [, update] of spaces) update(scene);
  stage.draw(scene);
  inspector.draw(scene);
  drawLine();
  drawWords(page, scene, tiles, healthPanel);
  if (scene.instant || page.pictures.size || isLoaded(player.t)) { wait(null); page.drawn += 1; }
}

function nearEnough(instant, t) {
  return instant && t - instant.t < 0.5 * SECOND ? instant : null;
}

function drawLine() {
  const { player } = page, loaded = [];
  for (const [k, state] of page.blocks) if (state === "there") loaded.push([k * SECOND, Math.min((k + 1) * SECOND, player.end)]);
  if (player.live) {
    const presence = new Map();
    for (const { t, people } of page.store.instants) {
      for (const { id } of people) {
        const span = presence.get(id) ?? [id, (t - player.begin) / SECOND, 0];
        span[2] = (t - player.begin) / SECOND;
        presence.set(id, span);
      }
    }
    line.setSpans([...presence.values()]);
  }
  line.draw(player.begin, player.end, player.t, loaded);
}

// ------------------------------------------------------------------------------- what people do

function select(what) {
  page.selected = what;
  redraw();
}

function showLayers() {
  const buttons = LAYERS.filter(isHere).map((layer) => {
    const button = document.createElement("button");
    button.textContent = layer.title;
    button.title = layer.hint;
    button.className = page.shown.has(layer.name) ? "on" : "";
    button.onclick = () => switchLayer(layer.name);
    return button;
  });
  $("layers").replaceChildren(...buttons);
}

// A layer whose topics nobody has is not offered.
function isHere(layer) {
  return layer.keys.every((key) => page.facts.topics.some(([there]) => there === key));
}

function switchLayer(name) {
  if (!page.shown.delete(name)) page.shown.add(name);
  const layer = LAYERS.find((each) => each.name === name);
  if (layer.keys.length) { page.blocks.clear(); source.show(keys()); }
  showLayers();
  redraw();
}

function step(places) {
  const instant = page.store?.stepFrom(page.player.t, places) ?? page.store?.imageFrom(page.player.t, places);
  page.player.playing = false;
  if (instant) page.player.t = instant.t;
  redraw();
}

function toggleHealth() {
  $("health").hidden = !$("health").hidden;
  $("health-switch").classList.toggle("on", !$("health").hidden);
  redraw();
}

function fit() {
  stage.fit(page.cameras, page.instant?.people ?? []);
  redraw();
}

const KEYS = {
  " ": () => page.player.toggle(), ArrowLeft: () => step(-1), ArrowRight: () => step(1), f: fit, h: toggleHealth,
  "[": () => page.player.faster(-1), "]": () => page.player.faster(1), Escape: () => select(null),
  Home: () => page.player.seek(page.player.begin), End: () => page.player.seek(page.player.end),
};
addEventListener("keydown", (event) => {
  if (event.target.matches("select, input") || event.ctrlKey || event.metaKey || !page.player) return;
  if (event.shiftKey && event.key.startsWith("Arrow")) page.player.seek(page.player.t + (event.key === "ArrowLeft" ? -SECOND : SECOND));
  else if (KEYS[event.key]) KEYS[event.key]();
  else return;
  event.preventDefault();
  redraw();
});
$("play").onclick = () => { page.player.toggle(); redraw(); };
$("back").onclick = () => step(-1);
$("on").onclick = () => step(1);
$("fit").onclick = fit;
$("health-switch").onclick = toggleHealth;
$("speed").replaceChildren(...SPEEDS.map((speed) => new Option(`${speed}×`, speed)));
$("speed").onchange = () => { page.player.speed = Number($("speed").value); redraw(); };
let pressed = null;
$("stage").addEventListener("pointerdown", (event) => { pressed = [event.offsetX, event.offsetY]; });
$("stage").addEventListener("pointerup", (event) => {
  const still = pressed && Math.hypot(event.offsetX - pressed[0], event.offsetY - pressed[1]) < 4;
  if (still) select(stage.pick(event.offsetX, event.offsetY, page.instant?.people ?? [], page.facts.skeleton.bones));
});
$("divider").onpointerdown = (event) => $("divider").setPointerCapture(event.pointerId);
$("divider").onpointermove = (event) => {
  if (event.buttons) document.querySelector("main").style.setProperty("--side", `${Math.max(160, innerWidth - event.clientX)}px`);
};

exposeForTests({ page, tiles, stage, select, switchLayer, step, redraw });
requestAnimationFrame(frame);
