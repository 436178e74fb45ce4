// The plots of all pages: of a running graph, of recorded runs, of an exported file, of a report.
//
//   const plots = ctcPlots.mount(element, data, options);
//
// data = {joints: ['joint1', ...], units: ['rad', ...], runs: [run, ...]}: one or more runs, each in
// its colour. Units are those of the positions, by default rad.
// run = {name: 'chattering', t: [...], signals: {e: [[...], ...], V: [[...]], ...}}: times [s],
// and for each signal one column for each joint, V one in all. Arrays may be plain or typed.
// A run may have its colour, '#rrggbb', and received: true where torques stand at times of
// reception. Instead of t and signals it may have packed: ['...', ...], which `coded` of Python
// writes, one for all signals of the same times; or what `ctcPlots.inflated` makes of `compressed`.
// Signals: q, q_d, dq, e, v, V, torque, nominal, compensation, robust, effort; each may miss, and
// what is not there cannot be chosen. q, q_d or e follows from the other two. Torque rate, log10
// of V and spectra are computed here. Every sample is drawn: where there are more samples than
// pixels, least and greatest value of each column of pixels; where there are few, each with a dot.
//
// options = {
//   signals: ['e', 'V', ...],  // chosen at first; see KINDS
//   storage: 'name',           // under which choices are remembered, if the browser allows it
//   wheel: 'always',           // zooms; by default with Ctrl only, and the page scrolls else
//   settled: 1.0,              // errors and torques before it do not scale the axes [s]
//   window: 10.0,              // a running graph: the last seconds are followed [s]
//   onSeek: t => {},           // a click at a time
//   onPoint: t => {},          // the time under the pointer, null for none
// }
// plots.append(buffer)   adds packed samples (ArrayBuffer), to the run that their head says; in
//                        place of those there if it says fresh. Signals of other times than those
//                        there are samples of their own, as slower ones of a graph
// plots.mark(t)          draws a line at a time; null for none
// plots.show(from, to)   zooms; without arguments all is shown, or the last seconds
// plots.remove()         takes all away

class Plots {
  constructor(element, data, options = {}) {
    this.element = made('div', element, 'ctc-plots');
    this.options = options;
    this.cursor = this.marked = this.view = null;
    // Where the pointer is, as a part of the width, and its frequency in a spectrum [Hz].
    this.pointer = this.frequency = null;
    this.chosen = { signals: options.signals || ['e', 'q', 'V', 'torque'], joints: null,
      ...this.remembered() };
    this.panels = [];
    // Of a running graph only what is in sight is drawn.
    this.seen = new IntersectionObserver(() => this.redraw());
    this.replace(data);
    this.resized = new ResizeObserver(() => this.resize());
    this.resized.observe(this.element);
    this.themed = () => this.build();
    dark.addEventListener('change', this.themed);
  }
  // Show other data.
  replace(data) {
    this.data = data;
    this.runs = (data.runs || []).map(run => new Run(run));
    this.view = null;
    this.build();
  }
  remembered() {
    try {
      const { signals, joints } = JSON.parse(localStorage.getItem(this.options.storage));
      if (!Array.isArray(signals)) return {};
      return { signals, joints: Array.isArray(joints) ? joints : null };
    } catch { return {}; }
  }
  remember() {
    try { // A page from a disk may have no storage.
      if (this.options.storage)
        localStorage.setItem(this.options.storage, JSON.stringify(this.chosen));
    } catch { /* Then nothing is remembered. */ }
  }
  choose(name, values) { this.chosen[name] = values; this.remember(); this.build(); }
  get joints() {
    const names = this.data.joints, chosen = this.chosen.joints || names;
    const found = names.map((_, i) => i).filter(i => chosen.includes(names[i]));
    return found.length ? found : names.map((_, i) => i);
  }
  build() {
    this.seen.disconnect();
    for (const panel of this.panels) panel.u.destroy();
    this.element.replaceChildren();
    this.panels = [];
    this.legend = [];
    this.runs.forEach((run, r) => { run.ink = run.colour ? onGround(run.colour) : colour(r); });
    this.known = Object.keys(KINDS).filter(kind => this.runs.length > !!KINDS[kind].between
      && KINDS[kind].lines.some(signal => this.runs.some(run => run.has(signal))));
    this.bars();
    const shown = this.known.filter(kind => this.chosen.signals.includes(kind));
    const joints = this.joints;
    this.small = joints.length > 3;
    // A plot for each joint, unless a few lines are all there is.
    for (const kind of shown) {
      const row = made('div', this.element, 'ctc-row');
      const together = this.runs.length === 1 && joints.length <= 3
        && KINDS[kind].lines.length === 1;
      const groups = KINDS[kind].common ? [[0]] : together ? [joints] : joints.map(i => [i]);
      const legend = groups.length > 1 ? made('p', row, 'ctc-legend') : null;
      const panels = groups.map(group => new Panel(this, row, kind, group, Boolean(legend)));
      this.panels.push(...panels);
      if (legend) for (const line of panels[0].lines)
        this.legend.push({ line, key: keyOf(legend, line) });
    }
    for (const panel of this.panels) this.seen.observe(panel.element);
    this.resize();
    this.redraw();
  }
  bars() {
    const bar = name => {
      const element = made('div', this.element, 'ctc-bar');
      made('span', element, '', name);
      return element;
    };
    const toggled = (list, x, on) => list.filter(y => y !== x).concat(on ? [x] : []);
    const signals = bar('signals');
    for (const kind of this.known)
      chip(signals, KINDS[kind].title.replace('log₁₀ of s', 's'),
        this.chosen.signals.includes(kind),
        on => this.choose('signals', toggled(this.chosen.signals, kind, on)));
    if (this.data.joints.length > 1) {
      const joints = bar('joints'), shown = this.joints.map(i => this.data.joints[i]);
      for (const name of this.data.joints)
        chip(joints, name, shown.includes(name), on => {
          const chosen = toggled(shown, name, on);
          this.choose('joints', chosen.length === this.data.joints.length ? null : chosen);
        });
    }
    if (this.runs.length > 1) {
      const runs = bar('runs');
      for (const run of this.runs)
        chip(runs, run.name, run.shown, on => { run.shown = on; this.build(); })
          .style.borderBottom = `3px solid ${run.ink}`;
    }
    const tools = bar('');
    tools.firstChild.remove();
    const button = (text, done) => {
      const it = made('button', tools, '', text);
      it.type = 'button'; it.onclick = done;
      return it;
    };
    this.all = button(this.options.window ? 'follow' : 'all', () => this.show());
    button('PNG', () => save(this, 'png'));
    button('SVG', () => save(this, 'svg'));
    button('CSV', () => save(this, 'csv'));
    this.time = made('span', tools, 'ctc-time');
    const { wheel, onSeek, settled } = this.options;
    made('p', this.element, 'ctc-hint', [
      `Zoom: drag, or ${wheel === 'always' ? '' : 'Ctrl and '}wheel. Move: Shift and drag.`,
      'Show all: double-click.', onSeek ? 'Go to a time: click.' : '', 'Keys: ← → + − Home.',
      settled ? `Axes are scaled without errors and torques of the first ${Number(settled.toPrecision(3))} s.` : '',
    ].filter(Boolean).join(' '));
  }
  resize() {
    if (this.width === this.element.clientWidth && this.panels.every(panel => panel.sized)) return;
    this.width = this.element.clientWidth;
    for (const panel of this.panels) { panel.u.setSize(panel.size()); panel.sized = true; }
    this.redraw();
  }
  get ends() {
    const ends = this.runs.map(run => run.ends).filter(([begin]) => Number.isFinite(begin));
    if (!ends.length) return [0, 1];
    return [Math.min(...ends.map(x => x[0])), Math.max(...ends.map(x => x[1]))];
  }
  range() {
    const [begin, end] = this.ends;
    if (this.view) return this.view;
    if (this.options.window) return [end - this.options.window, end];
    return [begin, end > begin ? end : begin + 1];
  }
  show(from, to) {
    const [begin, end] = this.ends;
    if (from === undefined || !(to > from)) this.view = null;
    else {
      // No further than all, and no nearer than what numbers of 64 bits distinguish.
      const least = Math.max(1e-9 * Math.abs(end), 1e-7);
      const span = Math.min(Math.max(to - from, least), end - begin);
      const start = Math.min(Math.max(from, begin), end - span);
      this.view = span >= end - begin && !this.options.window ? null : [start, start + span];
    }
    this.redraw();
  }
  // Show the values at the time under the pointer, which is a part of the width; null for none.
  hover(part) {
    this.pointer = part;
    const [from, to] = this.range();
    this.point(part === null ? null : from + part * (to - from));
  }
  hoverSpectra(frequency) {
    this.frequency = frequency;
    for (const panel of this.panels) panel.place();
  }
  point(t) {
    if (t !== this.cursor) this.options.onPoint?.(t);
    this.cursor = t;
    const [from, to] = this.range();
    const at = t ?? this.marked;
    this.time.textContent = at === null ? '' : `t = ${fixed(at, decimals((to - from) / 2000))} s`;
    for (const panel of this.panels) panel.place();
  }
  mark(t) { this.marked = t; this.point(this.cursor); }
  append(buffer) {
    const more = unpacked(buffer);
    if (this.runs[more.head.run].take(more)) this.build(); else this.redraw();
  }
  // Draw at the next frame; with slow drawing, seldom enough to leave the browser time.
  redraw() {
    if (this.waiting) return;
    this.waiting = true;
    setTimeout(() => requestAnimationFrame(() => {
      this.waiting = false;
      const begin = performance.now();
      for (const panel of this.panels) if (!this.options.window || panel.visible) panel.update();
      this.all.setAttribute('aria-pressed', String(!this.view));
      this.hover(this.pointer);
      // uPlot draws after this function, and the browser after that.
      setTimeout(() => { this.pause = Math.min(1000, 2 * (performance.now() - begin)); });
    }), this.pause || 0);
  }
  remove() {
    dark.removeEventListener('change', this.themed);
    this.resized.disconnect();
    this.seen.disconnect();
    for (const panel of this.panels) panel.u.destroy();
    this.panels = [];
    this.element.remove();
  }
}

// --- files
function download(name, blob) {
  const link = made('a'), url = URL.createObjectURL(blob);
  link.href = url; link.download = name; link.click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}
async function save(plots, format) {
  for (const panel of plots.panels) panel.update();
  await new Promise(requestAnimationFrame);  // uPlot draws later.
  if (format === 'png') picture(plots).toBlob(blob => download('plots.png', blob));
  else if (format === 'svg')
    download('plots.svg', new Blob([vectors(plots)], { type: 'image/svg+xml' }));
  else for (const run of plots.runs.filter(x => x.shown)) {
    const lines = plots.panels.filter(panel => !KINDS[panel.kind].spectrum).flatMap(
      panel => panel.lines.filter(line => line.run === run).map(line => ({ ...line, panel })));
    // A file for signals of the same times.
    [...new Set(lines.map(line => line.t))].forEach((t, k) => download(
      `${run.name.replace(/[^\w.-]+/g, '_') || 'plots'}${k ? '_' + (k + 1) : ''}.csv`,
      new Blob([table(plots, t, lines.filter(line => line.t === t))], { type: 'text/csv' })));
  }
}
// The samples shown, as columns of what is chosen.
function table(plots, t, lines) {
  const [from, to] = plots.range(), begin = first(t, from), end = first(t, to + 1e-9);
  const quoted = text => `"${text.replaceAll('"', '""')}"`;
  const rows = [['t [s]', ...lines.map(({ signal, joint, panel }) => quoted(
    `${signal} ${KINDS[panel.kind].common ? '' : plots.data.joints[joint]} [${panel.unit}]`))]];
  for (let i = begin; i < end; i++) rows.push([t[i], ...lines.map(line => line.at(i))]);
  return rows.map(row => row.join(',')).join('\n') + '\n';
}
// Where the first row begins.
const topOf = plots => plots.element.querySelector('.ctc-row')?.getBoundingClientRect().top
  ?? plots.element.getBoundingClientRect().top;
function picture(plots) {
  const box = plots.element.getBoundingClientRect(), ratio = Math.max(2, devicePixelRatio);
  const top = topOf(plots) - box.top;
  const canvas = made('canvas'), ctx = canvas.getContext('2d');
  canvas.width = box.width * ratio; canvas.height = (box.height - top) * ratio;
  const style = getComputedStyle(plots.element);
  ctx.fillStyle = style.backgroundColor; ctx.fillRect(0, 0, canvas.width, canvas.height);
  ctx.setTransform(ratio, 0, 0, ratio, -box.left * ratio, -(box.top + top) * ratio);
  const write = (element, ink, weight) => {
    const place = element.getBoundingClientRect();
    ctx.fillStyle = ink; ctx.font = `${weight} ${FONT}`;
    ctx.fillText(element.textContent, place.left, place.top + 12);
  };
  for (const panel of plots.panels) {
    const at = panel.u.ctx.canvas.getBoundingClientRect();
    ctx.drawImage(panel.u.ctx.canvas, at.left, at.top, at.width, at.height);
    write(panel.title, style.color, 600);
    panel.keys.forEach((key, i) => write(key.parentElement, panel.lines[i].ink, 400));
  }
  for (const { line, key } of plots.legend) write(key, line.ink, 400);
  return canvas;
}
