'use strict';
// Values under the pointer, zoom by dragging, tables to the clipboard. A finger taps for values and holds before it
// drags, because a swipe scrolls; two fingers are left to the browser, which enlarges the page. Everything is read from the figures themselves:
// data-panels of an SVG says where each panel lies and what it measures, and the groups bear the panels' names.
(() => {
  const SVG = 'http://www.w3.org/2000/svg', NEAR = 14, SMALLEST = 6, HOLD_MS = 350, STILL = 10;
  const make = (tag, className, text) => Object.assign(document.createElement(tag), { className, textContent: text });
  const shown = (x, span) => {
    const digits = Math.max(0, Math.min(12, 3 - Math.floor(Math.log10(span || 1))));
    return x.toFixed(digits).replace(/(\.\d*?)0+$/, '$1').replace(/\.$/, '').replace('-', '−').replace(/^−0$/, '0');
  };

  // places as numbers: what a path or a marker was drawn with, x and y in turn
  const places = (d) => (d.match(/-?[\d.]+(?:e-?\d+)?/g) || []).map(Number);

  class Panel {
    constructor(svg, told, prefix) {
      Object.assign(this, told);
      this.whole = { x: told.x, y: told.y };
      this.group = svg.getElementById(prefix + told.id);
      this.axes = { x: svg.getElementById(`${prefix}${told.id}-x`), y: svg.getElementById(`${prefix}${told.id}-y`) };
      this.points = [];
      told.lines.forEach((label, k) => {
        const group = svg.getElementById(`${prefix}${told.id}-line${k}`);
        for (const path of group ? group.querySelectorAll(':scope > path') : []) {
          const at = places(path.getAttribute('d'));
          for (let i = 0; i + 1 < at.length; i += 2) this.points.push([at[i], at[i + 1], label]);
        }
        for (const use of group ? group.querySelectorAll('use') : [])
          this.points.push([+use.getAttribute('x'), +use.getAttribute('y'), label]);
      });
    }
    holds([x, y]) { const [l, t, r, b] = this.box; return x >= l && x <= r && y >= t && y <= b; }
    // from the figure's places as first drawn to those under the zoom, and to values
    scale(way) {
      const [low, high] = this.whole[way], [a, b] = this[way], from = way === 'x' ? this.box[0] : this.box[3];
      const to = way === 'x' ? this.box[2] : this.box[1], first = (v) => from + (v - low) / (high - low) * (to - from);
      const factor = (high - low) / (b - a);
      return { factor, shift: from - factor * first(a), place: (v) => from + (v - a) / (b - a) * (to - from),
        value: (p) => a + (p - from) / (to - from) * (b - a) };
    }
    nearest(at) {
      const sx = this.scale('x'), sy = this.scale('y');
      let best = null, least = NEAR * NEAR;
      for (const [px, py, label] of this.points) {
        const x = sx.factor * px + sx.shift, y = sy.factor * py + sy.shift;
        const off = (x - at[0]) ** 2 + (y - at[1]) ** 2;
        if (off < least && this.holds([x, y])) { least = off; best = [x, y, label]; }
      }
      return best;
    }
    says(at) {
      const found = this.nearest(at), [x, y, label] = found || [...at, ''];
      this.found = found;
      const [wx, wy] = [this.says_[0] || 'x', this.says_[1] || 'y'];
      return [found ? label : null, `${wx}: ${shown(this.scale('x').value(x), this.x[1] - this.x[0])}`,
        `${wy}: ${shown(this.scale('y').value(y), this.y[1] - this.y[0])}`].filter(Boolean).join('\n');
    }
    zoom(x, y) {
      if (x) this.x = x;
      if (y) this.y = y;
      const sx = this.scale('x'), sy = this.scale('y');
      const inAxes = (e) => this.axes.x.contains(e) || this.axes.y.contains(e);
      for (const e of this.group.querySelectorAll('[clip-path] use, path[clip-path], [clip-path] path')) {
        if (inAxes(e)) continue;
        const key = e.tagName === 'use' ? ['x', 'y'] : ['d'];
        e.first = e.first || key.map((k) => e.getAttribute(k));
        if (key.length === 2) {
          e.setAttribute('x', sx.factor * e.first[0] + sx.shift);
          e.setAttribute('y', sy.factor * e.first[1] + sy.shift);
        } else {
          let n = 0;
          e.setAttribute('d', e.first[0].replace(/-?[\d.]+(?:e-?\d+)?/g,
            (v) => (n++ % 2 ? sy.factor * v + sy.shift : sx.factor * v + sx.shift).toFixed(2)));
        }
      }
      if (x) this.ticks('x', sx);
      if (y) this.ticks('y', sy);
    }
    // one of the figure's own ticks is copied to each round number in sight
    ticks(way, scale) {
      const axis = this.axes[way], own = [...axis.querySelectorAll(':scope > [id*="tick_"]')];
      axis.querySelectorAll('.zoomed').forEach((e) => e.remove());
      const zoomed = this[way] !== this.whole[way];
      own.forEach((e) => { e.style.display = zoomed ? 'none' : ''; });
      const from = own[0] && own[0].querySelector('use');
      if (!zoomed || !from) return;
      const [a, b] = this[way], rough = (b - a) / 5, ten = 10 ** Math.floor(Math.log10(rough));
      const step = ten * [1, 2, 5, 10].find((m) => m * ten >= rough);
      for (let k = Math.ceil(a / step - 1e-9); k * step <= b + 1e-9 * step; k++) {
        const tick = own[0].cloneNode(true), off = scale.place(k * step) - from.getAttribute(way);
        tick.setAttribute('class', 'zoomed');
        tick.removeAttribute('id');
        tick.style.display = '';
        tick.setAttribute('transform', way === 'x' ? `translate(${off} 0)` : `translate(0 ${off})`);
        const text = tick.querySelector('text');
        if (text) text.textContent = shown(k * step, step * 5);
        axis.append(tick);
      }
    }
  }

  document.querySelectorAll('figure svg[data-panels]').forEach((svg) => {
    const figure = svg.parentElement, told = JSON.parse(svg.dataset.panels);
    const first = svg.querySelector('[id$="figure_1"]');
    if (!first || !told.length) return;
    const prefix = first.id.slice(0, -'figure_1'.length);
    let panels = null, drag = null, frame = null, finger = null, tapped = null;
    const all = () => panels || (panels = told.map((t) => new Panel(svg, { ...t, says_: t.says, says: undefined }, prefix))
      .map((p) => (delete p.says, p)).filter((p) => p.group));
    const tip = figure.appendChild(make('div', 'says', ''));
    const whole = figure.querySelector('figcaption').appendChild(make('button', '', 'Show all'));
    const spot = svg.appendChild(document.createElementNS(SVG, 'circle'));
    spot.setAttribute('style', 'fill:none;stroke:#d55e00;stroke-width:1.2;pointer-events:none');
    tip.hidden = whole.hidden = true;
    const place = (e) => {
      const p = new DOMPoint(e.clientX, e.clientY).matrixTransform(svg.getScreenCTM().inverse());
      return [p.x, p.y];
    };
    const reset = () => { all().forEach((p) => p.zooms && p.zoom(p.whole.x, p.whole.y)); whole.hidden = true; };
    const tell = (e) => {
      const at = place(e), panel = all().find((p) => p.holds(at));
      tip.hidden = !panel;
      spot.setAttribute('r', 0);
      if (!panel) return;
      tip.textContent = panel.says(at);
      spot.setAttribute('r', panel.found ? 3.5 : 0);
      if (panel.found) ['cx', 'cy'].forEach((key, i) => spot.setAttribute(key, panel.found[i]));
      const box = figure.getBoundingClientRect(), x = e.clientX - box.left, y = e.clientY - box.top;
      const beside = x > box.width / 2 ? x - tip.offsetWidth - 12 : x + 14;
      tip.style.left = `${figure.scrollLeft + Math.max(0, Math.min(beside, box.width - tip.offsetWidth))}px`;
      tip.style.top = `${Math.max(0, y - tip.offsetHeight - 10)}px`;
    };
    const hide = () => { tip.hidden = true; spot.setAttribute('r', 0); };
    const letGo = () => { if (finger) clearTimeout(finger.timer); finger = null; };
    svg.addEventListener('pointerdown', (e) => {
      const at = place(e), panel = all().find((p) => p.zooms && p.holds(at));
      if (e.button) return;
      if (e.pointerType !== 'touch') {
        if (panel) begin(e, panel, at);
        return;
      }
      if (finger || drag) return letGo();
      const timer = setTimeout(() => { if (panel) { begin(e, panel, at); tell(e); } }, HOLD_MS);
      finger = { timer, x: e.clientX, y: e.clientY };
    });
    const begin = (e, panel, at) => {
      drag = { panel, at, pointer: e.pointerId };
      frame = svg.appendChild(document.createElementNS(SVG, 'rect'));
      frame.setAttribute('style', 'fill:#0072b2;fill-opacity:.15;stroke:#0072b2;stroke-width:.6');
      svg.setPointerCapture(e.pointerId);
      e.preventDefault();
    };
    const span = (e) => {
      const at = place(e), [l, t, r, b] = drag.panel.box, inside = (v, lo, hi) => Math.min(hi, Math.max(lo, v));
      const x = [drag.at[0], inside(at[0], l, r)].sort((p, q) => p - q);
      const y = [drag.at[1], inside(at[1], t, b)].sort((p, q) => p - q);
      const flat = y[1] - y[0] < SMALLEST * 2, thin = x[1] - x[0] < SMALLEST * 2;
      return { x: thin && !flat ? [l, r] : x, y: flat ? [t, b] : y, click: flat && thin, flat, thin };
    };
    const moved = (e) => finger && Math.hypot(e.clientX - finger.x, e.clientY - finger.y) > STILL;
    svg.addEventListener('pointermove', (e) => {
      if (e.pointerType === 'touch' && !drag) {
        if (moved(e)) letGo();
        return;
      }
      tell(e);
      if (!drag || e.pointerId !== drag.pointer) return;
      const { x, y } = span(e);
      for (const [key, v] of [['x', x[0]], ['y', y[0]], ['width', x[1] - x[0]], ['height', y[1] - y[0]]])
        frame.setAttribute(key, v);
    });
    const end = (e) => {
      const still = finger && !moved(e);
      letGo();
      if (!drag) {
        if (e.pointerType === 'touch' && e.type === 'pointerup' && still) tap(e);
        return;
      }
      if (e.pointerType === 'touch') hide();
      const { panel } = drag, { x, y, click, flat, thin } = span(e);
      frame.remove();
      drag = null;
      if (click || e.type === 'pointercancel') return;
      const sx = panel.scale('x'), sy = panel.scale('y');
      const wide = thin ? null : x.map(sx.value), high = flat ? null : [sy.value(y[1]), sy.value(y[0])];
      for (const p of all()) {
        if (!p.zooms) continue;
        const below = p.box[0] === panel.box[0] && p.whole.x.join() === panel.whole.x.join();
        p.zoom(p === panel || below ? wide : null, p === panel ? high : null);
      }
      whole.hidden = false;
    };
    const tap = (e) => {
      const again = tapped && e.timeStamp - tapped.time < HOLD_MS && Math.hypot(e.clientX - tapped.x, e.clientY - tapped.y) < 24;
      tapped = { time: e.timeStamp, x: e.clientX, y: e.clientY };
      if (again) reset();
      else tell(e);
    };
    svg.addEventListener('pointerup', end);
    svg.addEventListener('pointercancel', end);
    svg.addEventListener('pointerleave', (e) => { if (e.pointerType !== 'touch') hide(); });
    svg.addEventListener('touchmove', (e) => { if (drag) e.preventDefault(); }, { passive: false });
    svg.addEventListener('contextmenu', (e) => { if (finger || drag) e.preventDefault(); });
    document.addEventListener('pointerdown', (e) => { if (!svg.contains(e.target)) hide(); });
    svg.addEventListener('dblclick', reset);
    whole.addEventListener('click', reset);
  });

  const head = document.querySelector('h2');
  const how = matchMedia('(pointer: coarse)').matches ? 'tap for values, hold and drag for a closer look, double-tap'
    : 'point for values, drag for a closer look, double-click';
  if (head) head.before(make('p', 'hint', `In the figures: ${how} for the whole.`));

  // k with its index below is copied as k_r
  const text = (cell) => {
    const copy = cell.cloneNode(true);
    copy.querySelectorAll('sub').forEach((sub) => sub.prepend('_'));
    return copy.textContent.trim();
  };
  document.querySelectorAll('.table').forEach((box) => {
    const table = box.querySelector('table'), button = box.appendChild(make('button', '', 'Copy table'));
    button.type = 'button';
    button.addEventListener('click', async () => {
      const rows = [...table.rows].map((row) => [...row.cells].map(text).join('\t')).join('\n');
      try {
        await navigator.clipboard.writeText(rows);
        button.textContent = 'Copied';
      } catch {
        getSelection().selectAllChildren(table);
        button.textContent = 'Selected: copy it with the keyboard';
      }
      setTimeout(() => { button.textContent = 'Copy table'; }, 2000);
    });
  });

  addEventListener('beforeprint', () => document.querySelectorAll('details').forEach((d) => { d.open = true; }));
})();
