"use strict";
// Switch of themes, gallery and printing of the page.

const FIRST_CARDS = innerWidth < 620 ? 4 : 12;
const specs = JSON.parse(document.getElementById("charts").textContent);
const groups = [...document.querySelectorAll(".chartgroup")].map(e => new ChartGroup(e, specs));

for (const b of document.querySelectorAll("button[data-set-theme]")) b.addEventListener("click", () => { theme = b.dataset.setTheme; stored(theme); applyTheme(); });
system.addEventListener("change", applyTheme);
applyTheme();

class Gallery {
  constructor(element) {
    this.cards = [...element.querySelectorAll(".card")];
    this.selects = [...element.querySelectorAll("select")];
    this.count = element.querySelector(".count");
    this.order = element.querySelector("select[data-order]");
    this.list = element.querySelector(".cards");
    this.more = element.querySelector("button[data-more]");
    this.limit = FIRST_CARDS;
    this.more.addEventListener("click", () => { const next = this.shown()[this.limit - 1]; this.limit = Infinity; this.update(); next?.nextElementSibling?.querySelector("button").focus(); });
    for (const s of this.selects) s.addEventListener("change", () => this.update());
    element.querySelector("button[data-reset]").addEventListener("click", () => { for (const s of this.selects) s.selectedIndex = 0; this.update(); });
    for (const card of this.cards) card.querySelector("button").addEventListener("click", () => viewer.open(this, card));
    for (const b of element.closest("section").querySelectorAll(".brief button"))
      b.addEventListener("click", () => viewer.open(this, this.cards.find(c => c.dataset.place === b.dataset.shows), b));
    this.update();
  }
  shown() { return [...this.list.children].filter(c => !c.hidden); }
  update() {
    const wanted = this.selects.filter(s => s.dataset.filter && s.value);
    const [key, sign] = this.order.value.split(" ");
    const value = c => c.dataset[key] === "" ? Infinity : sign * c.dataset[key];
    this.list.append(...[...this.cards].sort((a, b) => value(a) - value(b)));
    let found = 0;
    for (const c of this.list.children) c.hidden = !wanted.every(s => c.dataset[s.dataset.filter] === s.value) || ++found > this.limit;
    const more = found - this.shown().length;
    this.more.hidden = more === 0;
    this.more.textContent = `Show ${more} more`;
    this.count.textContent = `${found} of ${this.cards.length} candidates`;
  }
}

class Viewer {
  constructor(dialog) {
    this.dialog = dialog;
    this.title = dialog.querySelector("h3");
    this.body = dialog.querySelector(".large");
    dialog.querySelector("[data-close]").addEventListener("click", () => dialog.close());
    dialog.querySelector("[data-next]").addEventListener("click", () => this.step(1));
    dialog.querySelector("[data-previous]").addEventListener("click", () => this.step(-1));
    dialog.addEventListener("keydown", e => {
      const by = { ArrowRight: 1, ArrowLeft: -1 }[e.key];
      if (by) { this.step(by); e.preventDefault(); }
    });
    dialog.addEventListener("click", e => { if (e.target === dialog) dialog.close(); });
    dialog.addEventListener("close", () => (this.from ?? this.card.querySelector("button")).focus());
  }
  open(gallery, card, from = null) {
    this.gallery = gallery;
    this.from = from;
    this.show(card);
    this.dialog.showModal();
  }
  step(by) {
    const shown = this.gallery.shown();
    this.from = null;
    this.show(shown[(shown.indexOf(this.card) + by + shown.length) % shown.length]);
  }
  show(card) {
    this.card = card;
    this.dialog.classList.toggle("loss", card.classList.contains("loss"));
    this.title.textContent = card.querySelector("h3").textContent;
    const left = html("div"), right = html("div");
    const [frame, why, numbers, ...said] = [...card.querySelector(".more").children].map(n => n.cloneNode(true));
    left.append(frame, why, ...said);
    right.append(card.querySelector(".panels").cloneNode(true), numbers);
    this.body.replaceChildren(left, right);
    this.dialog.scrollTop = 0;
  }
}

const dialog = document.querySelector("dialog");
const viewer = dialog ? new Viewer(dialog) : null;
const galleries = [...document.querySelectorAll(".gallery")].map(e => new Gallery(e));

let opened = [];
window.addEventListener("beforeprint", () => {
  opened = [...document.querySelectorAll("details:not([open]):not(.screen-only)")];
  opened.forEach(d => { d.open = true; });
  root.dataset.theme = "light";
  groups.forEach(g => g.charts.forEach(c => c.draw(PRINT_WIDTH)));
});
window.addEventListener("afterprint", () => {
  opened.forEach(d => { d.open = false; });
  applyTheme();
  groups.forEach(g => g.charts.forEach(c => { if (c.host.clientWidth) c.draw(c.host.clientWidth); }));
});
