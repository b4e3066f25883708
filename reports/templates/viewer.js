"use strict";
/* Viewers of high dynamic range images, sorting of tables, tips on charts. No request leaves the page. */

const PACKED = JSON.parse(document.getElementById("images").textContent);
const decoded = new Map();

/* float16 codes -> numbers */
const HALF = (() => {
  const table = new Float32Array(65536);
  for (let code = 0; code < 65536; code++) {
    const sign = code & 0x8000 ? -1 : 1, exponent = (code >> 10) & 31, mantissa = code & 1023;
    table[code] = sign * (exponent === 0 ? mantissa * 2 ** -24
      : exponent === 31 ? (mantissa ? NaN : Infinity)
      : (1 + mantissa / 1024) * 2 ** (exponent - 15));
  }
  return table;
})();

function bytesOf(base64) {
  return Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
}

/* Inflate, undo the differences, join the byte planes: {width, height, channels, pixels[c][i]} */
async function unpack(name) {
  if (!decoded.has(name)) {
    decoded.set(name, (async () => {
      const p = PACKED[name], n = p.width * p.height;
      const stream = new Blob([bytesOf(p.data)]).stream().pipeThrough(new DecompressionStream("deflate"));
      const steps = new Uint8Array(await new Response(stream).arrayBuffer());
      const pixels = [];
      for (let c = 0; c < p.channels; c++) {
        const plane = new Float32Array(n);
        let high = 0, low = 0;
        for (let i = 0, at = 2 * c * n; i < n; i++) {
          high = (high + steps[at + i]) & 255;
          low = (low + steps[at + n + i]) & 255;
          plane[i] = HALF[(high << 8) | low] * p.scale;
        }
        pixels.push(plane);
      }
      return { ...p, data: null, pixels };
    })());
  }
  return decoded.get(name);
}

const at = (image, c, i) => image.pixels[Math.min(c, image.channels - 1)][i];
const display = (x) => 255 * (x <= 0.0031308 ? 12.92 * Math.max(x, 0) : 1.055 * Math.min(x, 1) ** (1 / 2.4) - 0.055);
const short = (x) => !Number.isFinite(x) ? String(x) : x === 0 ? "0"
  : Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3 ? x.toExponential(2) : x.toPrecision(4);
const round = (x) => String(Number(x.toPrecision(3)));
const signed = (x) => (x > 0 ? "+" : "") + short(x);

/* blue: too dark, red: too bright */
const STOPS = [[11, 61, 145], [79, 143, 217], [242, 241, 238], [224, 112, 90], [151, 17, 15]];
function diverging(t) {
  const s = 2 * (Math.max(-1, Math.min(1, t)) + 1), k = Math.min(3, Math.floor(s)), f = s - k;
  return STOPS[k].map((a, c) => a + f * (STOPS[k + 1][c] - a));
}

let active = null;

class Viewer {
  constructor(box) {
    this.box = box;
    this.about = JSON.parse(box.dataset.view);
    [this.width, this.height] = this.about.size;
    this.exposure = this.about.exposure;
    this.single = 0;
    this.centre = [this.width / 2, this.height / 2];
    this.zoom = 1;
    this.masked = this.about.unclear !== "";
    this.names = ["truth", this.about.technique.replaceAll("_", " "), "signed error"];
    if (this.about.tracer) this.names.push(`path tracer, ${this.about.spp} spp`);
    this.build();
  }

  build() {
    const views = this.box.querySelector(".views"), panes = this.box.querySelector(".panes");
    this.buttons = ["side by side", ...this.names].map((name, k) => {
      const button = document.createElement("button");
      button.textContent = name;
      button.title = `key ${k}`;
      button.onclick = () => this.show(k);
      views.append(button);
      return button;
    });
    this.panes = this.names.map((name) => {
      const pane = document.createElement("figure"), caption = document.createElement("figcaption");
      const canvas = document.createElement("canvas");
      pane.className = "pane";
      caption.textContent = name + (this.about.probes ? " (across: view cosine; down: optical depth)" : "");
      pane.append(caption, canvas);
      panes.append(pane);
      this.listen(canvas);
      return { pane, canvas };
    });
    this.slider = this.box.querySelector("input");
    this.slider.min = this.about.exposure - 10;
    this.slider.max = this.about.exposure + 10;
    this.slider.oninput = () => this.expose(Number(this.slider.value));
    this.box.addEventListener("pointerenter", () => { active = this; });
    this.box.addEventListener("focusin", () => { active = this; });
    new ResizeObserver(() => this.draw()).observe(panes);
    this.help();
    this.show(0);
  }

  async load() {
    try {
      const { truth, error, tracer, unclear } = this.about;
      this.truth = await unpack(truth);
      this.error = await unpack(error);
      if (tracer) this.tracer = await unpack(tracer);
      if (unclear) this.unclear = bytesOf(unclear);
      this.expose(this.exposure);
      this.box.dataset.ready = "yes";
    } catch (problem) {
      this.box.querySelector(".read").textContent = `The images cannot be shown: ${problem.message}`;
    }
  }

  /* Difference averaged over channels, the number that the error image shows. */
  difference(i) {
    let sum = 0;
    for (let c = 0; c < this.error.channels; c++) sum += this.error.pixels[c][i];
    return sum / this.error.channels;
  }

  value(k, c, i) {
    if (k === 3) return at(this.tracer, c, i);
    return at(this.truth, c, i) + (k === 1 ? at(this.error, c, i) : 0);
  }

  hidden(i) {
    return this.masked && (this.unclear[i >> 3] >> (7 - (i & 7))) & 1;
  }

  expose(stops) {
    this.exposure = Math.max(Number(this.slider.min), Math.min(Number(this.slider.max), stops));
    this.slider.value = this.exposure;
    this.box.querySelector("output").textContent = `${this.exposure >= 0 ? "+" : "−"}${Math.abs(this.exposure).toFixed(2)} stops`;
    this.range = this.about.range * 2 ** (this.about.exposure - this.exposure);
    const share = this.about.relative ? `, ${round(100 * this.range / this.about.mean)} % of the mean` : "";
    const grey = this.unclear ? "; grey: noise" : "";
    const scale = this.box.querySelector(".scale");
    const [low, high] = this.about.relative ? ["too dark", "too bright"] : ["too low", "too high"];
    scale.replaceChildren(`${low} −${round(this.range)}`, document.createElement("i"), `+${round(this.range)} ${high}${share}${grey}`);
    this.paint();
    this.draw();
  }

  /* Pixels of every view at this exposure, unscaled. */
  paint() {
    if (!this.error) return;
    const gain = 2 ** this.exposure, n = this.width * this.height;
    this.bitmaps = this.names.map((_, k) => {
      const canvas = document.createElement("canvas");
      canvas.width = this.width;
      canvas.height = this.height;
      const context = canvas.getContext("2d"), data = context.createImageData(this.width, this.height), out = data.data;
      for (let i = 0; i < n; i++) {
        let colour;
        if (k === 2) {
          const d = this.difference(i);
          colour = Number.isNaN(d) ? [255, 0, 255] : this.hidden(i) ? [176, 176, 174] : diverging(d / this.range);
        } else {
          const rgb = [0, 1, 2].map((c) => this.value(k, c, i));
          colour = rgb.some(Number.isNaN) ? [255, 0, 255] : rgb.map((v) => display(gain * v));
        }
        out.set(colour, 4 * i);
        out[4 * i + 3] = 255;
      }
      context.putImageData(data, 0, 0);
      return canvas;
    });
  }

  show(k) {
    if (k > this.names.length) return;
    this.single = k;
    this.buttons.forEach((b, i) => b.setAttribute("aria-pressed", i === k));
    const wide = this.box.clientWidth || 1240, columns = this.names.length;
    const side = k ? Math.min(wide, 768) : Math.min(400, Math.floor((wide - 16 * (columns - 1)) / columns));
    this.box.style.setProperty("--side", `${Math.max(side, 200)}px`);
    this.panes.forEach(({ pane }, i) => { pane.hidden = k !== 0 && i !== k - 1; });
    this.draw();
  }

  draw() {
    if (!this.bitmaps) return;
    this.panes.forEach(({ pane, canvas }, k) => {
      if (pane.hidden) return;
      const width = Math.round(pane.clientWidth * devicePixelRatio), height = Math.round(width * this.height / this.width);
      if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
      const context = canvas.getContext("2d"), scale = (width / this.width) * this.zoom;
      context.imageSmoothingEnabled = false;
      context.fillStyle = "#808080";
      context.fillRect(0, 0, width, height);
      const [x, y] = this.centre;
      context.setTransform(scale, 0, 0, scale, width / 2 - x * scale, height / 2 - y * scale);
      context.drawImage(this.bitmaps[k], 0, 0);
      if (this.cursor) {
        context.strokeStyle = "#ffb000";
        context.lineWidth = 1.5 / scale * devicePixelRatio;
        context.strokeRect(this.cursor[0], this.cursor[1], 1, 1);
      }
      context.setTransform(1, 0, 0, 1, 0, 0);
    });
  }

  /* Image coordinates under the pointer. */
  point(event) {
    const r = event.target.getBoundingClientRect(), scale = (r.width / this.width) * this.zoom;
    return [this.centre[0] + (event.clientX - r.left - r.width / 2) / scale,
            this.centre[1] + (event.clientY - r.top - r.height / 2) / scale];
  }

  listen(canvas) {
    let held = null;
    canvas.addEventListener("pointerdown", (e) => { held = this.point(e); canvas.setPointerCapture(e.pointerId); this.box.focus({ preventScroll: true }); });
    canvas.addEventListener("pointerup", () => { held = null; });
    canvas.addEventListener("pointermove", (e) => {
      const [x, y] = this.point(e);
      if (held && this.zoom > 1) {
        this.centre = [this.centre[0] + held[0] - x, this.centre[1] + held[1] - y];
        this.keepInside();
      }
      this.read(Math.floor(x), Math.floor(y));
    });
    canvas.addEventListener("pointerleave", () => { this.cursor = null; this.help(); this.draw(); });
    canvas.addEventListener("dblclick", (e) => this.magnify(2, this.point(e)));
    canvas.addEventListener("wheel", (e) => {
      if (!e.ctrlKey && document.activeElement !== this.box) return;
      e.preventDefault();
      this.magnify(2 ** (-e.deltaY / 300), this.point(e));
    }, { passive: false });
  }

  magnify(factor, about = this.centre) {
    const zoom = Math.max(1, Math.min(64, this.zoom * factor)), f = this.zoom / zoom;
    this.centre = this.centre.map((c, k) => about[k] + (c - about[k]) * f);
    this.zoom = zoom;
    this.keepInside();
    this.draw();
  }

  keepInside() {
    this.centre = this.centre.map((c, k) => {
      const half = this.about.size[k] / 2 / this.zoom;
      return Math.max(half, Math.min(this.about.size[k] - half, c));
    });
  }

  read(x, y) {
    if (!this.error || x < 0 || y < 0 || x >= this.width || y >= this.height) return;
    this.cursor = [x, y];
    const i = y * this.width + x;
    const channels = Math.max(this.truth.channels, this.error.channels);
    const all = (f) => Array.from({ length: channels }, (_, c) => f(c)).join("  ");
    const d = this.difference(i);
    let truth = 0;
    for (let c = 0; c < channels; c++) truth += this.value(0, c, i) / channels;
    const place = this.about.probes ? `depth ${y}, cosine ${x}` : `(${x}, ${y})`;
    const parts = [place,
      ["truth", all((c) => short(this.value(0, c, i)))],
      [this.names[1], all((c) => short(this.value(1, c, i)))],
      ["difference", all((c) => signed(at(this.error, c, i))) + (truth ? `  ${signed(100 * d / truth)} %` : "")]];
    if (this.tracer) parts.push([this.names[3], all((c) => short(this.value(3, c, i)))]);
    if (this.hidden(i)) parts.push("within the truth’s noise");
    const line = this.box.querySelector(".read");
    line.replaceChildren();
    parts.forEach((part, k) => {
      if (k) line.append("     ");
      if (Array.isArray(part)) {
        const b = document.createElement("b");
        b.textContent = part[1];
        line.append(`${part[0]} `, b);
      } else line.append(part);
    });
    if (this.about.unit) line.append(`     ${this.about.unit}`);
    this.draw();
  }

  help() {
    const keys = [["1", "truth"], ["2", "technique"], ["3", "signed error"]];
    if (this.about.tracer) keys.push(["4", "path tracer"]);
    keys.push(["0", "side by side"], ["e E", "exposure"], ["+ −", "zoom, or click and wheel"], ["m", "noise mask"], ["r", "reset"]);
    const line = this.box.querySelector(".read");
    line.replaceChildren();
    keys.filter(([key]) => key !== "m" || this.about.unclear).forEach(([key, text], k) => {
      const kbd = document.createElement("kbd");
      kbd.textContent = key;
      line.append(k ? "    " : "", kbd, ` ${text}`);
    });
    if (this.about.full[0] !== this.width) line.append(`    averaged from ${this.about.full.join("×")} to ${this.width}×${this.height}`);
  }

  key(name) {
    if (/^[0-9]$/.test(name)) this.show(Number(name));
    else if (name === "E") this.expose(this.exposure + 0.25);
    else if (name === "e") this.expose(this.exposure - 0.25);
    else if (name === "+" || name === "=") this.magnify(2);
    else if (name === "-") this.magnify(0.5);
    else if (name === "m" && this.about.unclear) { this.masked = !this.masked; this.paint(); this.draw(); }
    else if (name === "r") {
      this.zoom = 1;
      this.centre = [this.width / 2, this.height / 2];
      this.show(0);
      this.expose(this.about.exposure);
    } else if (name === "Escape") this.show(0);
    else return false;
    return true;
  }
}

const viewers = new Map([...document.querySelectorAll(".viewer")].map((box) => [box, new Viewer(box)]));
active = viewers.values().next().value || null;
const seen = new IntersectionObserver((entries) => {
  for (const e of entries) if (e.isIntersecting) { seen.unobserve(e.target); viewers.get(e.target).load(); }
}, { rootMargin: "800px" });
for (const box of viewers.keys()) seen.observe(box);

document.addEventListener("keydown", (e) => {
  const typing = e.target instanceof HTMLInputElement && e.target.type !== "range";
  if (!active || typing || e.ctrlKey || e.metaKey || e.altKey) return;
  if (active.key(e.key)) e.preventDefault();
});

/* A click on a column head sorts by data-sort, else by text; empty cells go last. */
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0];
  heads.forEach((head, column) => {
    head.tabIndex = 0;
    const sort = () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((h) => h.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const value = (row) => {
        const cell = [...row.cells].find((c, _, all) => position(all, c) === column);
        return cell ? cell.dataset.sort ?? cell.textContent.trim() : "";
      };
      const rows = [...body.rows].map((row) => [value(row), row]);
      rows.sort(([a], [b]) => {
        if (a === "" || b === "") return (a === "") - (b === "");
        const order = isNaN(a) || isNaN(b) ? a.localeCompare(b) : a - b;
        return down ? -order : order;
      });
      body.append(...rows.map(([, row]) => row));
    };
    head.addEventListener("click", sort);
    head.addEventListener("keydown", (e) => { if (e.key === "Enter") sort(); });
  });
}
function position(cells, cell) {
  let at = 0;
  for (const c of cells) { if (c === cell) return at; at += c.colSpan; }
  return -1;
}

/* The text of a mark of a chart under the pointer. */
const tip = document.getElementById("tip");
document.addEventListener("pointermove", (e) => {
  const mark = e.target instanceof Element ? e.target.closest("figure svg [aria-label][role='graphics-symbol']") : null;
  tip.hidden = !mark || mark.getAttribute("aria-roledescription") === "axis" || mark.tagName === "g";
  if (tip.hidden) return;
  tip.textContent = mark.getAttribute("aria-label");
  tip.style.left = `${Math.min(e.clientX + 12, innerWidth - 390)}px`;
  tip.style.top = `${e.clientY + 14}px`;
});

/* A link to a row inside a closed <details> opens it. */
function reveal() {
  const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const closed = target && target.closest("details:not([open])");
  if (closed) { closed.open = true; target.scrollIntoView(); }
}
addEventListener("hashchange", reveal);
reveal();
