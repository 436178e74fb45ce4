// One plot and what mouse, fingers and keys do in it; put between samples.js and svg.js.

// The palettes of Okabe and Ito for light and for dark ground; dashes distinguish without colour.
const COLOURS = {
  light: ['#0072b2', '#d55e00', '#009e73', '#b4508f', '#a87400', '#3a8fc4', '#707070'],
  dark: ['#56b4e9', '#ff8a3d', '#2cc79a', '#e59cc6', '#f0c24b', '#a9d8f7', '#b0b0b0'] };
const DASHES = [[], [6, 3], [2, 3], [9, 3, 2, 3], [4, 4], [12, 4], [1, 4]];
// What can be chosen: title, unit (p of positions, t of torques), lines with their signals.
const KINDS = {
  e: { title: 'error', unit: 'p', lines: ['e'] },
  q: { title: 'q and q_d', unit: 'p', lines: ['q', 'q_d'], whole: true },
  dq: { title: 'velocity dq', unit: 'p/s', lines: ['dq'] },
  v: { title: 'filtered error v', unit: 'p/s', lines: ['v'] },
  V: { title: 'log₁₀ of V', unit: 'J', lines: ['logV'], common: true, whole: true },
  torque: { title: 'torque', unit: 't', lines: ['torque', 'effort', 'nominal',
    'compensation', 'robust'] },
  difference: { title: 'torque minus that of the first run', unit: 't', lines: ['torque'],
    between: true },
  rate: { title: 'torque rate', unit: 't/s', lines: ['rate'] },
  spectrum_e: { title: 'log₁₀ of spectrum of error', unit: 'p', lines: ['e'], spectrum: true },
  spectrum_torque: { title: 'log₁₀ of spectrum of torque', unit: 't', lines: ['applied'],
    spectrum: true } };
const FONT = '12px system-ui, sans-serif';
const LEFT = 54;
const dark = matchMedia('(prefers-color-scheme: dark)');
// A page may choose: <html data-theme="dark">.
const isDark = () => (document.documentElement.dataset.theme || (dark.matches ? 'dark' : ''))
  === 'dark';
const colour = i => COLOURS[isDark() ? 'dark' : 'light'][i % 7];
// A colour that suits light ground, lighter on dark ground.
const onGround = hex => !isDark() ? hex : '#' + [1, 3, 5].map(i => Math.round(
  0.6 * parseInt(hex.slice(i, i + 2), 16) + 0.4 * 255).toString(16).padStart(2, '0')).join('');

function made(tag, parent, name, text) {
  const element = document.createElement(tag);
  if (name) element.className = name;
  if (text !== undefined) element.textContent = text;
  if (parent) parent.append(element);
  return element;
}
function chip(parent, text, checked, changed) {
  const label = made('label', parent), box = made('input', label);
  box.type = 'checkbox'; box.checked = checked; label.append(text);
  box.onchange = () => changed(box.checked);
  return label;
}

// What names a line: a piece of it, and run and signal where there are several.
function keyOf(parent, line) {
  const key = made('span', parent, 'ctc-key');
  if (!line.name && !line.label) return key;
  key.innerHTML = '<svg width="26" height="8"><line x2="26" y1="4" y2="4" stroke-width="2"'
    + ` stroke="${line.ink}" stroke-dasharray="${line.dash}"/></svg>`;
  if (line.name) made('span', key, 'ctc-name', line.name).title = line.name;
  key.append((line.name && line.label ? ' ' : '') + line.label);
  return key;
}

// --- one plot
class Panel {
  // With a legend of the row, only values stand in the plot, while there is a cursor.
  constructor(plots, parent, kind, joints, hasLegend) {
    Object.assign(this, { plots, kind, joints, view: null });
    this.element = made('div', parent, 'ctc-panel');
    this.element.tabIndex = 0;
    this.head = made('p', this.element);
    this.title = made('b', this.head);
    this.lines = this.listed();
    const values = hasLegend ? made('p', this.element, 'ctc-values') : null;
    this.keys = this.lines.map(line => {
      const key = hasLegend ? made('span', values, 'ctc-key') : keyOf(this.head, line);
      if (hasLegend) key.style.color = line.ink;
      return made('span', key, line.long ? 'ctc-value ctc-long' : 'ctc-value');
    });
    const ink = getComputedStyle(plots.element).color;
    const grid = { stroke: isDark() ? '#ffffff22' : '#0000001c', width: 1 };
    const axis = { stroke: ink, grid, ticks: { ...grid, size: 4 }, font: FONT, gap: 3 };
    const unit = KINDS[kind].spectrum ? ' Hz' : ' s';
    const digits = (u, splits, _a, _s, step) => splits.map(
      (x, i) => fixed(x, decimals(step)) + (i === splits.length - 1 ? unit : ''));
    const range = (u, low, high) => [low, high];
    this.u = new uPlot({
      ...this.size(), padding: [8, 20, 0, 0], legend: { show: false }, cursor: { show: false },
      scales: { x: { time: false, auto: false, range }, y: { auto: false, range } },
      axes: [{ ...axis, size: 22, space: 62, values: digits },
        { ...axis, size: LEFT, space: 20, values: (u, splits, _a, _s, step) => {
          const factor = 10 ** this.exponent, last = decimals(step / factor);
          return splits.map(x => (this.empty ? '' : fixed((x - this.offset) / factor, last)));
        } }],
      series: [{}, { paths: () => null, points: { show: false } }],
      hooks: { draw: [() => this.draw()] } }, [[0, 1], [0, 0]], this.element);
    for (const name of ['mark', 'cursor', 'select'])
      this[name] = made('div', this.u.over, 'ctc-' + name);
    gestures(this);
  }
  size() {
    return { width: Math.max(120, this.element.clientWidth),
      height: this.plots.small ? 118 : 165 };
  }
  listed() {
    const { runs, data } = this.plots, kind = KINDS[this.kind], found = [];
    const several = runs.length > 1, overlaid = this.joints.length > 1;
    const signals = kind.lines.filter(signal => runs.some(run => run.has(signal)));
    const shown = runs.filter(run => run.shown);
    if (kind.between) this.base = shown.shift();
    shown.forEach(run => this.joints.forEach(joint => signals.forEach(
      (signal, s) => run.has(signal) && found.push({
        run, joint, signal, long: signal === 'q' || signal === 'q_d',
        ink: several ? run.ink : colour(overlaid ? joint : s), dash: DASHES[s],
        name: several && s === 0 ? run.name : '',
        label: (overlaid ? data.joints[joint] : '') + (kind.lines.length > 1 ? signal : ''),
      }))));
    return found;
  }
  get unit() {
    const p = this.plots.data.units?.[this.joints[0]] || 'rad', t = p === 'm' ? 'N' : 'N·m';
    return KINDS[this.kind].unit.replace('p', p).replace('t', t);
  }
  get visible() {
    const { top, bottom } = this.element.getBoundingClientRect();
    return bottom > 0 && top < innerHeight;
  }
  // Take what is to be drawn, and scale the axes to it.
  update() {
    const [from, to] = this.plots.range();
    for (const line of this.lines) {
      const { t, at } = this.base ? difference(line.run.values(line.signal, line.joint),
        this.base.values(line.signal, line.joint)) : line.run.values(line.signal, line.joint);
      if (KINDS[this.kind].spectrum) {
        const [i, j] = [first(t, from), first(t, to)];
        const values = Float64Array.from({ length: j - i }, (_, k) => at(i + k));
        Object.assign(line, spectrum(values, (t[j - 1] - t[i]) / (j - i - 1)));
      } else Object.assign(line, { t, at });
    }
    const [low, high] = this.range = this.view || (KINDS[this.kind].spectrum ? [0, Math.max(
      1, ...this.lines.map(line => line.t[line.t.length - 1] || 0))] : [from, to]);
    const { spectrum: own, whole } = KINDS[this.kind];
    const settled = !own && !whole && this.plots.options.settled;
    let [least, most] = [Infinity, -Infinity];
    for (const { t, at } of this.lines) {
      const end = first(t, high + 1e-12);
      for (let i = first(t, settled && high > 2 * settled ? Math.max(low, settled) : low);
        i < end; i++) {
        const x = at(i);
        if (x < least) least = x;
        if (x > most) most = x;
      }
    }
    this.empty = !(least <= most);
    if (this.empty) [least, most] = [-1, 1];
    let margin = 0.06 * (most - least);
    if (margin <= 1e-14 * Math.max(Math.abs(least), Math.abs(most)))
      margin = Math.abs(most) * 1e-3 || 1;
    [least, most] = [least - margin, most + margin];
    Object.assign(this, scaled(least, most));
    const factor = this.exponent ? power(this.exponent) + ' ' : '';
    const joint = this.joints.length === 1 && !KINDS[this.kind].common
      ? ' of ' + this.plots.data.joints[this.joints[0]] : '';
    const offset = this.offset ? `, minus ${Number(this.offset.toPrecision(12))}` : '';
    const text = KINDS[this.kind].title + joint + offset + ` [${factor}${this.unit}]`
      + (KINDS[this.kind].spectrum ? ' over frequency [Hz]' : '')
      + (this.empty ? ': no samples' : '');
    if (this.title.textContent !== text) this.title.textContent = text;
    this.u.batch(() => {
      this.u.setScale('x', { min: low, max: high });
      this.u.setScale('y', { min: least, max: most });
    });
    this.place();
  }
  draw() {
    if (!this.range) return;
    const { ctx, bbox } = this.u, ratio = uPlot.pxRatio ?? devicePixelRatio;
    ctx.save(); ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height); ctx.clip();
    ctx.lineJoin = 'round';
    this.paint(ctx, bbox, ratio);
    ctx.restore();
  }
  // Draw the lines into a box of a canvas, or of what does as if it were one.
  paint(ctx, bbox, ratio) {
    ctx.lineWidth = 1.4 * ratio;
    for (const line of this.lines) {
      ctx.strokeStyle = ctx.fillStyle = line.ink;
      ctx.setLineDash(line.dash.map(x => x * ratio));
      this.trace(line, ctx, bbox, ratio);
    }
  }
  trace({ t, at }, ctx, bbox, ratio) {
    const { min, max } = this.u.scales.y, [low, high] = this.range;
    const x = i => bbox.left + (t[i] - low) / (high - low) * bbox.width;
    const y = v => bbox.top + (max - v) / (max - min) * bbox.height;
    const begin = Math.max(0, first(t, low) - 1), end = Math.min(t.length, first(t, high) + 1);
    const count = end - begin;
    // Lines end where samples are missing.
    const gap = count > 2 ? 2.5 * usual(t, begin, end) : Infinity;
    let [column, least, most, last] = [-1, 0, 0, 0], down = false, height = 0;
    const flush = () => {
      if (column < 0) return;
      ctx.lineTo(column, y(least)); ctx.lineTo(column, y(most)); ctx.lineTo(column, y(last));
      height += most - least;
    };
    ctx.beginPath();
    for (let i = begin; i < end; i++) {
      const v = at(i);
      if (v !== v) { flush(); column = -1; down = false; continue; }
      const dense = count > 2 * bbox.width, now = dense ? Math.round(x(i)) : x(i);
      if (down && i > begin && t[i] - t[i - 1] > gap) { flush(); column = -1; down = false; }
      if (dense && now === column) {
        if (v < least) least = v;
        if (v > most) most = v;
      } else {
        flush();
        if (down) ctx.lineTo(now, y(v)); else ctx.moveTo(now, y(v));
        [column, least, most, down] = [dense ? now : -1, v, v, true];
      }
      last = v;
    }
    flush();
    // Dashes of a band are no help, and take long.
    if (height > 10 * (max - min)) ctx.setLineDash([]);
    ctx.stroke();
    if (count * 5 * ratio > bbox.width) return;
    ctx.beginPath();
    for (let i = begin; i < end; i++) {
      ctx.moveTo(x(i), y(at(i))); ctx.arc(x(i), y(at(i)), 2 * ratio, 0, 7);
    }
    ctx.fill();
  }
  // Put the lines of cursor and mark, and write the values there.
  place() {
    const { cursor, marked } = this.plots, own = KINDS[this.kind].spectrum;
    const times = { cursor: own ? this.plots.frequency : cursor, mark: own ? null : marked };
    for (const [name, t] of Object.entries(times)) {
      const seen = t !== null && this.range && t >= this.range[0] && t <= this.range[1];
      this[name].style.display = seen ? 'block' : 'none';
      if (seen) this[name].style.left = this.u.valToPos(t, 'x') + 'px';
    }
    const t = times.cursor ?? times.mark;
    this.lines.forEach((line, i) => {
      const k = t === null || !line.t?.length ? -1 : nearest(line.t, t);
      this.keys[i].textContent = k < 0 ? '' : written(line.at(k), line.long);
    });
  }
}
// A signal less another one at the same times; nothing where the other has no sample.
function difference(one, other) {
  return { t: one.t, at: i => {
    const k = nearest(other.t, one.t[i]);
    return Math.abs(other.t[k] - one.t[i]) < 1e-6 ? one.at(i) - other.at(k) : NaN;
  } };
}
// The median of the time between two samples, of some of them.
function usual(t, begin, end) {
  const step = Math.max(1, Math.floor((end - begin) / 200)), found = [];
  for (let i = begin + 1; i < end; i += step) found.push(t[i] - t[i - 1]);
  return found.sort((a, b) => a - b)[found.length >> 1];
}
function nearest(t, at) {
  const k = first(t, at);
  return k > 0 && (k === t.length || at - t[k - 1] < t[k] - at) ? k - 1 : k;
}

// --- mouse, fingers, keys
function gestures(panel) {
  const { plots, element } = panel, over = panel.u.over, fingers = new Map();
  const spectrum = KINDS[panel.kind].spectrum;
  const left = event => event.clientX - over.getBoundingClientRect().left;
  // As it will be drawn: several events may come before the next frame.
  const range = () => (spectrum ? panel.view || panel.range : plots.range());
  const time = x => {
    const [a, b] = range();
    return a + x / over.clientWidth * (b - a);
  };
  const show = (from, to) => {
    if (!spectrum) plots.show(from, to);
    else { panel.view = from === undefined ? null : [Math.max(0, from), to]; panel.update(); }
  };
  const zoom = (at, factor, shift = 0) => {
    const [a, b] = range(), span = (b - a) * factor;
    const from = at - (at - a) * factor + shift;
    show(from, from + span);
  };
  let from = null, moved = false;
  over.onpointerdown = event => {
    if (event.button > 1) return;
    over.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, left(event));
    from = left(event); moved = false;
    if (event.button === 1) event.preventDefault();
  };
  over.onpointermove = event => {
    const x = left(event), before = fingers.get(event.pointerId);
    const pan = event.shiftKey || event.buttons === 4 || event.pointerType === 'touch';
    if (spectrum) plots.hoverSpectra(time(x)); else plots.hover(x / over.clientWidth);
    if (from === null || before === undefined) return;
    const others = [...fingers].filter(([id]) => id !== event.pointerId);
    moved ||= Math.abs(x - from) > 4;
    fingers.set(event.pointerId, x);
    if (others.length) {
      const other = others[0][1];
      if (Math.abs(x - other) > 10)
        zoom(time(other), Math.abs(before - other) / Math.abs(x - other));
    } else if (pan && moved) zoom(0, 1, time(before) - time(x));
    else if (moved) Object.assign(panel.select.style, {
      display: 'block', left: Math.min(x, from) + 'px', width: Math.abs(x - from) + 'px' });
  };
  over.onpointerup = event => {
    const x = left(event), drawn = panel.select.style.display === 'block';
    fingers.delete(event.pointerId);
    panel.select.style.display = 'none';
    const clicked = from !== null && !moved && event.button === 0 && !spectrum;
    if (clicked) plots.options.onSeek?.(time(x));
    if (drawn) show(...[time(from), time(x)].sort((a, b) => a - b));
    from = null;
  };
  over.onpointercancel = event => { fingers.delete(event.pointerId); from = null; };
  over.onpointerleave = () => { plots.hoverSpectra(null); plots.hover(null); };
  over.ondblclick = () => show();
  over.addEventListener('wheel', event => {
    if (plots.options.wheel !== 'always' && !event.ctrlKey) return;
    event.preventDefault();
    const span = range()[1] - range()[0];
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY))
      zoom(0, 1, (event.deltaX || event.deltaY) / over.clientWidth * span);
    else zoom(time(left(event)), Math.exp(Math.sign(event.deltaY) * Math.min(
      0.4, Math.abs(event.deltaY) / 300)));
  }, { passive: false });
  element.onkeydown = event => {
    const [a, b] = range(), keys = {
      ArrowLeft: () => zoom(0, 1, -0.1 * (b - a)), ArrowRight: () => zoom(0, 1, 0.1 * (b - a)),
      '+': () => zoom((a + b) / 2, 0.7), '-': () => zoom((a + b) / 2, 1 / 0.7),
      Home: () => show(), Escape: () => show() };
    if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
  };
}
