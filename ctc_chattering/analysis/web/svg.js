// The plots as SVG, drawn from the same samples as on the page; put between panel.js and plots.js.

// What a plot uses of a canvas, as elements of an SVG.
class SvgCanvas {
  constructor(parent) { Object.assign(this, { parent, path: '', dash: [] }); }
  beginPath() { this.path = ''; }
  moveTo(x, y) { this.add('M', x, y); }
  lineTo(x, y) { this.add('L', x, y); }
  add(letter, x, y) {
    const point = `${x.toFixed(1)} ${y.toFixed(1)}`;
    if (Number.isFinite(x + y) && (letter === 'M' || point !== this.last))
      this.path += letter + point;
    this.last = point;
  }
  arc(x, y, r) {
    if (Number.isFinite(x + y))
      this.path += `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`;
  }
  setLineDash(dash) { this.dash = dash; }
  stroke() {
    drawn('path', this.parent, { d: this.path, fill: 'none', stroke: this.strokeStyle,
      'stroke-width': this.lineWidth, 'stroke-dasharray': this.dash.join(' '),
      'stroke-linejoin': 'round' });
  }
  fill() { drawn('path', this.parent, { d: this.path, fill: this.fillStyle }); }
}
const SVG = made('p');
SVG.innerHTML = '<svg/>';
function drawn(tag, parent, attributes, text = '') {
  const element = document.createElementNS(SVG.firstChild.namespaceURI, tag);
  for (const [name, value] of Object.entries(attributes))
    if (value !== '') element.setAttribute(name, value);
  element.textContent = text;
  parent?.append(element);
  return element;
}
// All panels, where they are on the page, with titles and keys.
function vectors(plots) {
  const box = plots.element.getBoundingClientRect(), style = getComputedStyle(plots.element);
  const top = topOf(plots);
  const [width, height] = [box.width, box.bottom - top];
  const svg = drawn('svg', null, { width, height, viewBox: `0 0 ${width} ${height}`,
    'font-family': 'system-ui, sans-serif', 'font-size': 12 });
  drawn('rect', svg, { width, height, fill: style.backgroundColor });
  const place = element => {
    const { left, top: at, width: w, height: h } = element.getBoundingClientRect();
    return { x: left - box.left, y: at - top, width: w, height: h };
  };
  const write = (x, y, text, more) => drawn('text', svg, { x, y, fill: style.color, ...more }, text);
  const writeKey = (key, { ink, dash }) => {
    const at = place(key), sample = key.querySelector('svg');
    if (sample) drawn('line', svg, { x1: at.x, y1: at.y + 8, x2: at.x + 26, y2: at.y + 8,
      stroke: ink, 'stroke-width': 2, 'stroke-dasharray': dash.join(' ') });
    write(at.x + (sample ? 30 : 0), at.y + 12, key.textContent, { fill: ink });
  };
  for (const panel of plots.panels) {
    const { u } = panel, { x, y, width: w, height: h } = place(u.over), [across, up] = u.axes;
    const line = (x1, y1, x2, y2, more) => drawn('line', svg, { x1, y1, x2, y2, stroke: '#8886',
      ...more });
    (across._splits || []).forEach((value, i) => {
      const at = x + u.valToPos(value, 'x');
      line(at, y, at, y + h + 4);
      write(at, y + h + 17, across._values[i], { 'text-anchor': 'middle' });
    });
    (up._splits || []).forEach((value, i) => {
      const at = y + u.valToPos(value, 'y');
      line(x - 4, at, x + w, at);
      write(x - 7, at + 4, up._values[i], { 'text-anchor': 'end' });
    });
    // Finer than the pixels of the page.
    const ratio = 3, bbox = { left: 0, top: 0, width: w * ratio, height: h * ratio };
    const inside = drawn('svg', svg, { x, y, width: w, height: h,
      viewBox: `0 0 ${bbox.width} ${bbox.height}`, preserveAspectRatio: 'none' });
    if (panel.range) panel.paint(new SvgCanvas(inside), bbox, ratio);
    const title = place(panel.title);
    write(title.x, title.y + 12, panel.title.textContent, { 'font-weight': 600 });
    panel.keys.forEach(({ parentElement: key }, i) => writeKey(key, panel.lines[i]));
  }
  for (const { line, key } of plots.legend) writeKey(key, line);
  return new XMLSerializer().serializeToString(svg);
}
