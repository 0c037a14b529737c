// Zoom, cursor and legend of the charts of a page. Without it they stand as they are.
// A chart is a div.chart with an SVG, whose frame is in data-frame, and with its numbers as JSON. A page that gets new
// numbers while it is open calls `chart.pigtail.set(numbers)`.
'use strict';
(() => {
  const NS = 'http://www.w3.org/2000/svg';
  const TICKS = { x: 82, y: 42 }, SHADES = 32;
  const tag = (name, attributes, text) => {
    const e = document.createElementNS(NS, name);
    for (const k in attributes) e.setAttribute(k, attributes[k]);
    if (text !== undefined) e.textContent = text;
    return e;
  };
  const log = (axis, v) => axis.log ? Math.log10(Math.max(v, 5e-324)) : v;
  const back = (axis, v) => axis.log ? 10 ** v : v;

  // Which values stand at an axis: as scale.rs has it.
  function ticks(axis, from, to, room) {
    const low = Math.min(from, to), high = Math.max(from, to);
    if (axis.names) return axis.names.map((n, k) => [k, n]).filter(t => t[0] >= low && t[0] <= high);
    const count = Math.max(room, 2), all = [];
    if (axis.log && high > 3 * low) {
      const first = Math.floor(Math.log10(low)), last = Math.ceil(Math.log10(high));
      const wide = (last - first) * 3 <= 1.5 * count;
      for (let d = first; d <= last; d++) for (let m = 1; m < 10; m++) {
        const v = m * 10 ** d;
        if (v < low * (1 - 1e-9) || v > high * (1 + 1e-9)) continue;
        all.push([v, m === 1 || (wide && (m === 2 || m === 5)) ? String(+v.toPrecision(3)) : '']);
      }
      return all;
    }
    const nice = raw => {
      const power = 10 ** Math.floor(Math.log10(raw));
      return Math.max(([1, 2, 5].find(m => raw <= m * power * 1.0001) || 10) * power, axis.whole ? 1 : 0);
    };
    let step = nice((high - low) / count);
    if (!(step > 0)) return all;
    const finer = nice(0.35 * step);
    if (Math.floor(high / step + 1e-9) - Math.ceil(low / step - 1e-9) < 3 && finer * count > 0.6 * (high - low)) step = finer;
    const digits = Math.min(9, Math.max(0, -Math.floor(Math.log10(step * 1.0001))));
    for (let k = Math.ceil(low / step - 1e-9); k <= high / step + 1e-9; k++)
      all.push([k * step, (k * step).toFixed(digits).replace(/^-(0\.?0*)$/, '$1')]);
    return all;
  }

  class Chart {
    constructor(box) {
      this.box = box;
      this.svg = box.querySelector('svg');
      [this.left, this.top, this.right, this.bottom] = box.dataset.frame.split(' ').map(Number);
      this.hidden = new Set();
      this.read = document.createElement('output');
      this.svg.after(this.read);
      this.cursor = this.svg.appendChild(tag('path', { class: 'cursor' }));
      this.frame = this.svg.appendChild(tag('rect', { class: 'zoom' }));
      this.listen();
      this.set(JSON.parse(box.querySelector('script').textContent), true);
    }

    // Takes new numbers; `asDrawn` if the picture shows them already.
    set(numbers, asDrawn) {
      this.d = numbers;
      this.reset();
      if (!asDrawn) this.draw();
    }
    reset() {
      const { x, y } = this.d;
      this.ends = { x: [x.from, x.to], y: [y.from, y.to] };
    }

    at(name, v) {
      const axis = this.d[name], [a, b] = this.ends[name].map(e => log(axis, e));
      const [p, q] = name === 'x' ? [this.left, this.right] : [this.bottom, this.top];
      return p + (log(axis, v) - a) / (b - a) * (q - p);
    }
    value(name, place) {
      const axis = this.d[name], [a, b] = this.ends[name].map(e => log(axis, e));
      const [p, q] = name === 'x' ? [this.left, this.right] : [this.bottom, this.top];
      return back(axis, a + (place - p) / (q - p) * (b - a));
    }

    shade(v) {
      const c = this.d.colour, s = Math.min(1, Math.max(0, (v - c.low) / (c.high - c.low)));
      return Math.round((c.root ? Math.sqrt(s) : s) * (SHADES - 1)) || 0;
    }
    // The paths of a series: one, or one a shade.
    path(s) {
      const paths = {};
      let up = true, before = '';
      for (let i = 0; i < s.x.length; i++) {
        if (s.x[i] === null || s.y[i] === null) { up = true; continue; }
        const x = this.at('x', s.x[i]).toFixed(2), y = this.at('y', s.y[i]).toFixed(2);
        const key = s.v ? this.shade(s.v[i]) : '';
        let d;
        if (s.kind === 'line') {
          if (!up && before === x + y) continue;
          d = (up ? 'M' : 'L') + x + ' ' + y;
          before = x + y; up = false;
        } else if (s.class === 'cross') d = 'M' + (x - 7) + ' ' + y + 'h14m-7 -7v14';
        else if (s.kind === 'dots') d = 'M' + x + ' ' + y + 'h0';
        else d = 'M' + x + ' ' + y + 'H' + this.at('x', s.x1[i]).toFixed(2) + 'V' + this.at('y', s.y1[i]).toFixed(2) + 'H' + x + 'Z';
        paths[key] = (paths[key] || '') + d;
      }
      return paths;
    }

    draw() {
      this.d.series.forEach((s, k) => {
        const g = this.svg.querySelector('[data-k="' + k + '"]');
        if (!g) return;
        const paths = this.path(s);
        for (const p of g.children) p.setAttribute('d', paths[p.dataset.v === undefined ? '' : p.dataset.v] || '');
      });
      const { left, right, top, bottom } = this;
      const axes = this.svg.querySelector('.axes'), marks = this.svg.querySelector('.marks');
      axes.replaceChildren(); marks.replaceChildren();
      for (const [v, text] of ticks(this.d.x, ...this.ends.x, (right - left) / TICKS.x)) {
        const x = this.at('x', v);
        axes.append(tag('path', { d: `M${x} ${bottom}V${top}` }), tag('text', { x, y: bottom + 18, 'text-anchor': 'middle' }, text));
      }
      for (const [v, text] of ticks(this.d.y, ...this.ends.y, (bottom - top) / TICKS.y)) {
        const y = this.at('y', v);
        if (!this.d.y.names) axes.append(tag('path', { d: `M${left} ${y}H${right}` }));
        axes.append(tag('text', { x: left - 7, y: y + 4.5, 'text-anchor': 'end' }, text));
      }
      const bands = this.svg.querySelector('.bands');
      bands.replaceChildren();
      this.d.bands.forEach((b, k) => {
        const from = Math.max(left, this.at('x', b.from)), to = Math.min(right, this.at('x', b.to));
        if (to <= from) return;
        if (k % 2 === 0) bands.append(tag('path', { d: `M${from} ${top}H${to}V${bottom}H${from}Z` }));
        if (to - from > 9 * b.name.length + 6) marks.append(tag('text', { class: 'soft', x: from + 4, y: top + 15 }, b.name));
      });
      const upward = this.d.marks.some(m => m.axis === 'x');
      this.d.marks.forEach((m, k) => {
        const at = this.at(m.axis, m.at), across = m.axis === 'x';
        if (at < (across ? left : top) || at > (across ? right : bottom)) return;
        marks.append(tag('path', { class: m.class, d: across ? `M${at} ${bottom}V${top}` : `M${left} ${at}H${right}` }));
        const out = across ? at + 9 * m.name.length + 6 > right : !upward;
        marks.append(tag('text', {
          class: m.class, 'text-anchor': out ? 'end' : 'start',
          x: across ? at + (out ? -5 : 5) : out ? right - 5 : left + 5,
          y: across ? top + 15 + 17 * (k % 4 + (this.d.bands.length ? 1 : 0)) : at - top < 20 ? at + 15 : at - 5,
        }, m.name));
      });
    }

    // The place of a pointer in units of the picture.
    place(event) {
      const p = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
      return [Math.min(this.right, Math.max(this.left, p.x)), Math.min(this.bottom, Math.max(this.top, p.y))];
    }
    // What a series has nearest to a place: along x where it goes one way, else in the picture.
    nearest(s, px, py) {
      if (s.oneWay === undefined)
        s.oneWay = s.kind === 'line' && s.x.every((v, i) => i === 0 || v >= s.x[i - 1]);
      let best = -1, least = s.oneWay ? 1e9 : 40;
      for (let i = 0; i < s.x.length; i++) {
        if (s.x[i] === null || s.y[i] === null) continue;
        const x = this.at('x', s.x[i]), y = this.at('y', s.y[i]);
        let d;
        if (s.kind === 'boxes') {
          const x1 = this.at('x', s.x1[i]), y1 = this.at('y', s.y1[i]);
          const inside = px >= Math.min(x, x1) && px <= Math.max(x, x1) && (!s.v || (py >= Math.min(y, y1) && py <= Math.max(y, y1)));
          d = inside ? 0 : 1e9;
        } else d = s.oneWay ? Math.abs(x - px) : Math.hypot(x - px, y - py);
        if (d < least) { least = d; best = i; }
      }
      return best;
    }
    point(event) {
      const [px, py] = this.place(event), digits = v => v === null || v === undefined ? '-' : String(+v.toPrecision(6));
      this.cursor.setAttribute('d', `M${px} ${this.bottom}V${this.top}M${this.left} ${py}H${this.right}`);
      const unit = this.d.y.label.includes(', ') ? ' ' + this.d.y.label.split(', ').pop() : '';
      const said = [this.d.x.label + ' ' + digits(this.value('x', px))];
      if (!this.d.y.names) said[0] += ' · ' + this.d.y.label + ' ' + digits(this.value('y', py));
      this.d.series.forEach((s, k) => {
        if (this.hidden.has(k)) return;
        const i = this.nearest(s, px, py);
        if (i < 0) return;
        const name = s.name ? s.name + ': ' : '';
        if (s.v) said.push(name + (this.d.colour.label || 'value') + ' ' + digits(s.v[i]));
        else if (s.kind === 'boxes') said.push(`${name}${digits(s.x[i])} to ${digits(s.x1[i])}` + (this.d.y.names ? '' : ': ' + digits(s.y1[i])));
        else said.push(name + (s.oneWay ? '' : digits(s.x[i]) + ', ') + digits(s.y[i]) + (s.oneWay ? unit : ''));
      });
      this.read.textContent = said.join('   ');
    }

    listen() {
      let from = null;
      this.svg.addEventListener('pointerdown', e => {
        if (e.button !== 0 || e.pointerType === 'touch') return;
        from = this.place(e);
        this.svg.setPointerCapture(e.pointerId);
        e.preventDefault();
      });
      const area = to => {
        const w = Math.abs(to[0] - from[0]), h = Math.abs(to[1] - from[1]);
        // A drag along one axis zooms that one.
        return {
          x: h > 12 && w < 12 ? [this.left, this.right] : [Math.min(from[0], to[0]), Math.max(from[0], to[0])],
          y: h < 12 ? [this.bottom, this.top] : [Math.max(from[1], to[1]), Math.min(from[1], to[1])],
        };
      };
      this.svg.addEventListener('pointermove', e => {
        this.point(e);
        if (!from) return;
        const { x, y } = area(this.place(e));
        for (const [k, v] of [['x', x[0]], ['y', y[1]], ['width', x[1] - x[0]], ['height', y[0] - y[1]]]) this.frame.setAttribute(k, v);
      });
      this.svg.addEventListener('pointerup', e => {
        if (!from) return;
        const to = this.place(e), { x, y } = area(to);
        if (Math.hypot(to[0] - from[0], to[1] - from[1]) > 6) {
          this.ends = { x: x.map(v => this.value('x', v)), y: y.map(v => this.value('y', v)) };
          this.draw();
        }
        from = null;
        this.frame.setAttribute('width', 0);
      });
      this.svg.addEventListener('pointerleave', () => { this.cursor.setAttribute('d', ''); this.read.textContent = ''; });
      this.svg.addEventListener('dblclick', () => { this.reset(); this.draw(); });
      for (const key of this.box.querySelectorAll('.key')) {
        key.tabIndex = 0;
        key.setAttribute('role', 'switch');
        key.setAttribute('aria-checked', 'true');
        const flip = () => {
          const k = +key.dataset.k, on = this.hidden.delete(k) || !this.hidden.add(k);
          key.setAttribute('aria-checked', on);
          this.svg.querySelector('[data-k="' + k + '"]').style.display = on ? '' : 'none';
        };
        key.addEventListener('click', flip);
        key.addEventListener('keydown', e => { if (e.key === 'Enter' || e.key === ' ') { e.preventDefault(); flip(); } });
      }
    }
  }
  for (const box of document.querySelectorAll('.chart')) box.pigtail = new Chart(box);
  document.body.classList.add('live');
})();
