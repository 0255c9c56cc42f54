"use strict";
// Draws the charts of reports/charts.py as SVG. Colours come from style sheets, so that a theme needs no redraw.

const SVG = "http://www.w3.org/2000/svg";
const PRINT_WIDTH = 330;
const DASH = { solid: "", longdash: "16 4", dashed: "7 4", dashdot: "9 4 2 4", dotted: "2 3" };

function make(name, attributes, parent, text) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  if (parent) parent.append(node);
  return node;
}

function html(name, className, parent, text) {
  const node = document.createElement(name);
  if (className) node.className = className;
  if (text !== undefined) node.textContent = text;
  if (parent) parent.append(node);
  return node;
}

function paint(node, look) {
  node.style.setProperty("--light", look.light);
  node.style.setProperty("--dark", look.dark);
  return node;
}

function swatch(look) {
  const svg = make("svg", { width: 26, height: 10, class: "swatch", "aria-hidden": "true" });
  const line = make("line", { x1: 1, x2: 25, y1: 5, y2: 5, class: "line", "stroke-width": 2.6, "stroke-dasharray": DASH[look.dash] }, svg);
  paint(line, look);
  return svg;
}

class Scale {
  constructor(axis, linear, from, to) {
    this.log = axis.log && !linear;
    this.low = axis.log && linear ? 0 : axis.low;
    this.high = axis.log && linear ? axis.linear_high : axis.high;
    this.percent = axis.percent;
    this.digits = axis.digits;
    this.from = from;
    this.to = to;
  }
  share(value) {
    const v = Math.min(Math.max(value, this.low), this.high);
    return this.log ? Math.log(v / this.low) / Math.log(this.high / this.low) : (v - this.low) / (this.high - this.low || 1);
  }
  at(value) { return this.from + (this.to - this.from) * this.share(value); }
  value(place) {
    const s = Math.min(Math.max((place - this.from) / (this.to - this.from), 0), 1);
    return this.log ? this.low * (this.high / this.low) ** s : this.low + (this.high - this.low) * s;
  }
  ticks(count) {
    if (this.log) {
      const decades = Math.log10(this.high / this.low), found = [];
      const within = decades > 3 ? [1] : decades > 2 ? [1, 3] : [1, 2, 5];
      for (let e = Math.floor(Math.log10(this.low)); e <= Math.log10(this.high); e++)
        for (const m of within) if (m * 10 ** e >= this.low * .999 && m * 10 ** e <= this.high * 1.001) found.push(m * 10 ** e);
      return found;
    }
    const rough = (this.high - this.low) / count, power = 10 ** Math.floor(Math.log10(rough || 1));
    const step = [1, 2, 2.5, 5, 10].map(m => m * power).find(s => s >= rough * .999);
    const found = [];
    for (let i = Math.ceil(this.low / step - 1e-9); i * step <= this.high + 1e-9; i++) found.push(i * step);
    return found;
  }
  tick(value) { return this.percent ? `${+(value * 100).toFixed(1)} %` : String(+value.toPrecision(3)); }
  text(value) {
    if (value === null) return "–";
    return this.percent ? `${(value * 100).toFixed(1)} %` : value.toFixed(this.digits);
  }
}

class Chart {
  constructor(host, spec, group) {
    Object.assign(this, { host, spec, group, width: 0, at: null });
    this.small = host.closest(".small") !== null;
    this.low = host.closest(".first") !== null;
    this.tip = html("div", "tip", host);
    this.tip.hidden = true;
    this.tip.setAttribute("role", "status");
    this.legend = html("ul", "legend", host.parentElement);
    host.after(this.legend);
    host.addEventListener("pointermove", e => this.point(e));
    host.addEventListener("pointerdown", e => this.point(e));
    host.addEventListener("pointerleave", () => this.rest());
    host.addEventListener("blur", () => this.rest());
    host.addEventListener("keydown", e => this.key(e));
    new ResizeObserver(() => { if (host.clientWidth && host.clientWidth !== this.width) this.draw(host.clientWidth); }).observe(host);
  }
  shown() { return this.spec.lines.filter(l => l.tags.every(t => this.group.on.has(t))); }
  redraw() { if (this.width) this.draw(this.width); }
  draw(width) {
    this.width = width;
    const height = Math.round(this.small ? Math.min(width * .72, 210) : this.low ? 200 : Math.min(Math.max(width * .72, 250), 370));
    this.box = { left: this.small ? 44 : this.low ? 56 : 64, right: width - 10, top: 8, bottom: height - (this.small ? 26 : this.low ? 36 : 44) };
    const { left, right, top, bottom } = this.box;
    this.x = new Scale(this.spec.x, this.group.linear, left, right);
    this.y = new Scale(this.spec.y, false, bottom, top);
    this.svg?.remove();
    this.svg = make("svg", { viewBox: `0 0 ${width} ${height}`, "aria-hidden": "true" });
    this.host.prepend(this.svg);
    this.axes(height);
    const id = `${this.host.id}-clip`;
    make("rect", { x: left, y: top - 4, width: right - left, height: bottom - top + 8 }, make("clipPath", { id }, make("defs", {}, this.svg)));
    const inside = make("g", { "clip-path": `url(#${id})` }, this.svg);
    if (this.spec.diagonal) make("line", { x1: this.x.at(0), y1: this.y.at(0), x2: this.x.at(1), y2: this.y.at(1), class: "diagonal" }, inside);
    if (this.spec.level !== null) make("line", { x1: left, x2: right, y1: this.y.at(this.spec.level), y2: this.y.at(this.spec.level), class: "across" }, inside);
    const lines = this.shown();
    if (this.group.bands) for (const line of lines) this.band(line, inside);
    for (const line of lines) this.line(line, inside);
    this.cursor = make("line", { y1: top, y2: bottom, class: "cursor", visibility: "hidden" }, this.svg);
    this.dots = make("g", {}, this.svg);
    this.legend.replaceChildren(...lines.map(l => {
      const item = html("li");
      // the switches above name the lines of a low chart
      item.append(swatch(l.look), this.low ? "" : l.name);
      if (this.low) item.title = l.name;
      if (!this.small) html("span", "of", item, l.figure);
      return item;
    }));
    if (this.small) this.legend.hidden = true;
  }
  axes(height) {
    const { left, right, top, bottom } = this.box, svg = this.svg;
    for (const v of this.x.ticks(this.small ? 4 : 6)) {
      make("line", { x1: this.x.at(v), x2: this.x.at(v), y1: top, y2: bottom, class: "grid" }, svg);
      make("text", { x: this.x.at(v), y: bottom + 17, "text-anchor": "middle" }, svg, this.x.tick(v));
    }
    for (const v of this.y.ticks(this.small ? 4 : 5)) {
      make("line", { x1: left, x2: right, y1: this.y.at(v), y2: this.y.at(v), class: "grid" }, svg);
      make("text", { x: left - 7, y: this.y.at(v) + 4, "text-anchor": "end" }, svg, this.y.tick(v));
    }
    make("path", { d: `M${left},${top}V${bottom}H${right}`, class: "frame" }, svg);
    if (this.small) return;
    make("text", { x: (left + right) / 2, y: height - (this.low ? 4 : 7), "text-anchor": "middle" }, svg, this.spec.x.label);
    make("text", { transform: `translate(12 ${(top + bottom) / 2}) rotate(-90)`, "text-anchor": "middle" }, svg, (this.low && this.spec.y.short) || this.spec.y.label);
  }
  path(xs, ys, step) {
    let d = "", last = null;
    for (let i = 0; i < xs.length; i++) {
      if (xs[i] === null || ys[i] === null) { last = null; continue; }
      const x = this.x.at(xs[i]).toFixed(1), y = this.y.at(ys[i]).toFixed(1);
      if (last === null) d += `M${x},${y}`;
      else if (step) { if (y !== last) d += `H${x}V${y}`; else if (i === xs.length - 1) d += `H${x}`; }
      else d += `L${x},${y}`;
      last = y;
    }
    return d;
  }
  band(line, parent) {
    if (!line.band || line.band.x.length < 2) return;
    const { x, low, high } = line.band, back = [...x].reverse(), under = [...low].reverse();
    const d = this.path(x, high, false) + this.path(back, under, false).replace("M", "L") + "Z";
    paint(make("path", { d, class: "area" }, parent), line.look);
  }
  line(l, parent) {
    if (l.broad) {
      const use = l.x.map((v, i) => v >= l.broad[0] - 1e-9 && v <= l.broad[1] + 1e-9 ? i : -1).filter(i => i >= 0);
      paint(make("path", { d: this.path(use.map(i => l.x[i]), use.map(i => l.y[i]), false), class: "broad" }, parent), l.look);
    }
    const width = this.small ? l.look.width * .8 : l.look.width;
    paint(make("path", { d: this.path(l.x, l.y, l.step), class: "line", "stroke-width": width, "stroke-dasharray": DASH[l.look.dash] }, parent), l.look);
    if (l.bars) l.x.forEach((v, i) => paint(make("line", { x1: this.x.at(v), x2: this.x.at(v), y1: this.y.at(l.bars.low[i]), y2: this.y.at(l.bars.high[i]), class: "line", "stroke-width": 1 }, parent), l.look));
    if (l.markers) l.x.forEach((v, i) => l.y[i] !== null && paint(make("circle", { cx: this.x.at(v), cy: this.y.at(l.y[i]), r: this.small ? 2 : 3, class: "dot" }, parent), l.look));
    if (l.mark && l.mark[1] !== null) paint(make("circle", { cx: this.x.at(l.mark[0]), cy: this.y.at(l.mark[1]), r: 6, class: "dot marked" }, parent), l.look);
  }
  // place of the point that is read off at an x, or -1
  reading(l, x) {
    const xs = l.x;
    if (l.read === "last") { let i = -1; while (i + 1 < xs.length && xs[i + 1] !== null && xs[i + 1] <= x * (1 + 1e-9) + 1e-12) i++; return i; }
    if (l.read === "first") return xs.findIndex(v => v !== null && v >= x - 1e-12);
    let best = -1;
    xs.forEach((v, i) => { if (l.y[i] !== null && (best < 0 || Math.abs(v - x) < Math.abs(xs[best] - x))) best = i; });
    return best;
  }
  point(e) {
    const box = this.host.getBoundingClientRect();
    this.show((e.clientX - box.left) * this.width / box.width);
  }
  key(e) {
    const { left, right } = this.box, step = (right - left) / 60;
    const to = { ArrowLeft: -step, ArrowRight: step, PageUp: 10 * step, PageDown: -10 * step }[e.key];
    if (e.key === "Escape") this.rest();
    else if (e.key === "Home") this.show(left);
    else if (e.key === "End") this.show(right);
    else if (to !== undefined) this.show(this.at === null ? (left + right) / 2 : this.at + to);
    else return;
    e.preventDefault();
  }
  rest() {
    this.at = null;
    this.tip.hidden = true;
    this.cursor.setAttribute("visibility", "hidden");
    this.dots.replaceChildren();
  }
  show(place) {
    const { left, right, top, bottom } = this.box;
    this.at = Math.min(Math.max(place, left), right);
    const x = this.x.value(this.at), lines = this.shown();
    this.cursor.setAttribute("x1", this.at);
    this.cursor.setAttribute("x2", this.at);
    this.cursor.setAttribute("visibility", "visible");
    this.dots.replaceChildren();
    const said = html("div", "of", null, `${this.spec.x.label.split(":")[0]}: ${this.x.text(x)}`), table = html("table");
    for (const l of lines) {
      const i = this.reading(l, x), never = i < 0 || l.y[i] === null, row = html("tr", "", table);
      html("td", "", row).append(swatch(l.look), l.name);
      html("b", "", html("td", "", row), never ? "never" : l.text[i] ?? this.y.text(l.y[i]));
      if (i >= 0 && l.threshold) html("td", "of", row, l.threshold[i] === null ? "threshold above all scores" : `threshold ${l.threshold[i].toFixed(4)}`);
      if (never) continue;
      const at = l.read === "nearest" ? this.x.at(l.x[i]) : this.at;
      paint(make("circle", { cx: at, cy: this.y.at(l.y[i]), r: 4.5, class: "dot marked" }, this.dots), l.look);
    }
    this.tip.replaceChildren(said, table);
    this.tip.hidden = false;
    const room = this.host.clientWidth, scale = room / this.width, own = this.tip.offsetWidth;
    const beside = this.at * scale + 14 + own < room ? this.at * scale + 14 : this.at * scale - 14 - own;
    this.tip.style.left = `${Math.max(0, Math.min(beside, room - own))}px`;
    this.tip.style.top = `${top + (bottom - top) * .3}px`;
  }
}

class ChartGroup {
  constructor(element, specs) {
    this.on = new Set();
    this.linear = false;
    this.bands = true;
    for (const button of element.querySelectorAll("button[data-tag]")) {
      const look = JSON.parse(button.dataset.look);
      button.prepend(swatch(look));
      if (button.getAttribute("aria-pressed") === "true") this.on.add(button.dataset.tag);
      this.toggle(button, on => this.on[on ? "add" : "delete"](button.dataset.tag));
    }
    const bands = element.querySelector("button[data-bands]"), log = element.querySelector("button[data-log]");
    if (bands) this.toggle(bands, on => { this.bands = on; });
    if (log) this.toggle(log, on => { this.linear = !on; });
    const kinds = [...element.querySelectorAll(".kind")], choices = [...element.querySelectorAll("button[data-kind]")];
    for (const choice of choices) choice.addEventListener("click", () => {
      choices.forEach(c => c.setAttribute("aria-pressed", c === choice));
      kinds.forEach(k => { k.hidden = k.dataset.kind !== choice.dataset.kind; });
      if (log) log.hidden = !this.charts.some(c => c.spec.x.linear_high !== null && !c.host.closest(".kind").hidden);
    });
    this.charts = [...element.querySelectorAll(".plot")].map(p => new Chart(p, specs[p.id], this));
  }
  toggle(button, act) {
    button.addEventListener("click", () => {
      const on = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", on);
      act(on);
      this.charts.forEach(c => c.redraw());
    });
  }
}
