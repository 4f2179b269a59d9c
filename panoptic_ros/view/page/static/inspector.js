// The panel of a person: joints, and the views that measured one of them, or all.

import { cssOf } from "#view/colors.js";
import { STATES, evidence, isThere, personEvidence, place, principalSpread, spread } from "#view/people.js";

export class Inspector {
  constructor(element, choose) {
    this.element = element;
    this.choose = choose;
    this.shown = "";
    element.onclick = (event) => {
      const row = event.target.closest("[data-joint]");
      if (row) choose({ id: this.id, joint: Number(row.dataset.joint) });
      if (event.target.closest("button")) choose(null);
    };
  }

  draw(scene) {
    const { selected } = scene;
    this.element.hidden = !selected;
    if (!selected) return;
    this.id = selected.id;
    const person = scene.instant?.people.find(({ id }) => id === selected.id);
    const html = person ? this._person(scene, person, selected.joint) : head(selected.id, "is not there now");
    if (html === this.shown) return;
    const list = this.element.querySelector(".joints"), scrolled = list ? list.scrollTop : 0;
    this.element.innerHTML = this.shown = html;
    const now = this.element.querySelector(".joints");
    if (now) now.scrollTop = scrolled;
  }

  _person(scene, person, chosen) {
    const names = scene.facts.skeleton.joints;
    const rows = names.map((name, joint) => {
      const there = isThere(person, joint), sigma = there ? Math.hypot(...spread(person, joint)) : NaN;
      return `<tr data-joint="${joint}" class="${joint === chosen ? "chosen" : ""}"><td><i class="state ${STATES[person.states[joint]]}"></i>${escape(name)}</td>
        <td>${STATES[person.states[joint]]}</td><td>${there ? person.views[joint] : "–"}</td><td>${there ? sigma.toFixed(0) : "–"}</td></tr>`;
    });
    const measured = names.filter((_, joint) => person.states[joint] === 1).length;
    return `${head(person.id, `score ${person.score.toFixed(2)} · ${measured} of ${names.length} joints measured`)}
      ${Number.isInteger(chosen) ? this._joint(scene, person, chosen) : views(scene, person)}
      <div class="joints"><table><thead><tr><th>joint</th><th>state</th><th>views</th><th>σ mm</th></tr></thead><tbody>${rows.join("")}</tbody></table></div>`;
  }

  _joint(scene, person, joint) {
    const at = place(person, joint), name = escape(scene.facts.skeleton.joints[joint]);
    if (!at) return `<h3>${name}</h3><p>missing</p>`;
    const axes = principalSpread(person, joint).map((s) => s.toFixed(1)).join(" · ");
    const rows = evidence(scene.store, scene.cameras, scene.instant, person, joint).map(({ camera, state, score, residual }) => {
      const length = residual ? Math.hypot(...residual) : null;
      const error = residual ? `${length.toFixed(1)} <small>(${residual.map((r) => r.toFixed(0)).join(", ")})</small>` : "–";
      return `<tr class="${residual ? "" : "dim"}"><td>${escape(camera)}</td><td>${state}</td><td>${score ? score.toFixed(2) : "–"}</td><td>${error}</td></tr>`;
    });
    return `<h3>${name}</h3>
      <dl><dt>position m</dt><dd>${at.map((x) => x.toFixed(3)).join(", ")}</dd>
      <dt>σ x, y, z mm</dt><dd>${spread(person, joint).map((s) => s.toFixed(1)).join(", ")}</dd>
      <dt>σ along axes mm</dt><dd>${axes}</dd>
      <dt>score, views</dt><dd>${person.scores[joint].toFixed(2)}, ${person.views[joint]}</dd></dl>
      <table><thead><tr><th>camera</th><th>2D joint</th><th>score</th><th>residual px</th></tr></thead><tbody>${rows.join("")}</tbody></table>`;
  }
}

function views(scene, person) {
  const rows = personEvidence(scene.store, scene.cameras, scene.instant, person).map(({ camera, state, joints, rms }) =>
    `<tr class="${joints ? "" : "dim"}"><td>${escape(camera)}</td><td>${state}</td><td>${joints || "–"}</td><td>${rms === null ? "–" : rms.toFixed(1)}</td></tr>`);
  return `<table><thead><tr><th>camera</th><th></th><th>joints</th><th>rms px</th></tr></thead><tbody>${rows.join("")}</tbody></table>`;
}

function head(id, text) {
  return `<header><i style="background:${cssOf(id)}"></i><h2>id ${id}</h2><span>${escape(text)}</span><button title="close (Esc)">×</button></header>`;
}

export function escape(text) {
  return String(text).replace(/[&<>"']/g, (c) => `&#${c.charCodeAt(0)};`);
}
