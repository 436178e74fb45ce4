// Numbers as text, spectra, and the samples of a run; put before panel.js.

// --- numbers
// Number of the first of increasing times that is not below t.
function first(times, t) {
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < t) low = middle + 1; else high = middle;
  }
  return low;
}
// Digits after the point in multiples of a step.
function decimals(step) {
  const digits = Math.min(14, Math.max(0, Math.ceil(-Math.log10(step) - 1e-6)));
  const last = step * 10 ** digits;
  return Math.abs(last - Math.round(last)) > 1e-6 ? digits + 1 : digits;
}
function fixed(x, digits) {
  const text = x.toFixed(digits);
  return Number(text) === 0 ? text.replace('-', '') : text.replace('-', '−');
}
const power = n => '10' + String(n).replace(/./g, c => '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'['-0123456789'.indexOf(c)]);
function written(x, long) {
  if (!Number.isFinite(x)) return '–';
  if (long) return fixed(x, 9);
  return (x === 0 || (Math.abs(x) >= 1e-2 && Math.abs(x) < 1e5) ? x.toPrecision(5)
    : x.toExponential(3)).replace(/-/g, '−');
}
// Factor (a power of ten) and offset with which ticks from low to high have few digits.
function scaled(low, high) {
  const range = high - low, largest = Math.max(Math.abs(low), Math.abs(high));
  const step = 10 ** Math.ceil(Math.log10(range));
  const offset = largest > 1e3 * range ? Math.round((low + high) / 2 / step) * step : 0;
  const size = offset ? range : largest;
  const usual = size >= 0.05 && size < 2e4;
  return { offset, exponent: usual ? 0 : 3 * Math.floor(Math.log10(size) / 3) };
}
// Amplitudes over frequency of evenly spaced samples: Hann's window, mean over long stretches.
function spectrum(values, period) {
  const size = Math.min(2 ** 14, 2 ** Math.floor(Math.log2(values.length)));
  if (!(size >= 16)) return { t: [], at: () => NaN };
  const powers = new Float64Array(size / 2), starts = [];
  const count = Math.ceil(values.length / size);
  for (let s = 0; s < count; s++)
    starts.push(count > 1 ? Math.round(s * (values.length - size) / (count - 1)) : 0);
  for (const start of starts) {
    const re = new Float64Array(size), im = new Float64Array(size);
    let mean = 0;
    for (let i = 0; i < size; i++) mean += (values[start + i] || 0) / size;
    for (let i = 0; i < size; i++)
      re[i] = ((values[start + i] || 0) - mean) * (1 - Math.cos(2 * Math.PI * i / size)) / 2;
    transform(re, im);
    for (let i = 0; i < size / 2; i++) powers[i] += (re[i] ** 2 + im[i] ** 2) / count;
  }
  // An amplitude of 1 has the value 1: the window's mean is 1/2, half is at negative frequency.
  const amplitudes = powers.map(x => 0.5 * Math.log10(Math.max(x, 1e-300)) + Math.log10(4 / size));
  return { t: Float64Array.from(powers, (_, i) => i / size / period), at: i => amplitudes[i] };
}
// Fast Fourier transform in place, of a power of two numbers.
function transform(re, im) {
  const n = re.length;
  for (let i = 1, j = 0; i < n; i++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) [re[i], re[j], im[i], im[j]] = [re[j], re[i], im[j], im[i]];
  }
  for (let size = 2; size <= n; size *= 2)
    for (let k = 0; k < size / 2; k++) {
      const c = Math.cos(2 * Math.PI * k / size), s = -Math.sin(2 * Math.PI * k / size);
      for (let i = k; i < n; i += size) {
        const j = i + size / 2, x = re[j] * c - im[j] * s, y = re[j] * s + im[j] * c;
        re[j] = re[i] - x; im[j] = im[i] - y; re[i] += x; im[i] += y;
      }
    }
}

// --- samples
const MOST = 120_000;  // Samples of a running graph that are kept.
// What is computed from other signals, the first that is there; and what follows from two.
const NEEDS = { logV: ['V'], rate: ['torque', 'effort'], applied: ['torque', 'effort'] };
const FOLLOWS = { q: ['q_d', 'e'], q_d: ['q', 'e'], e: ['q_d', 'q'] };
// See `packed` in Python: length of the head, the head in JSON, times and columns.
function unpacked(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const run = { signals: {}, head };
  let at = 8 * Math.ceil((4 + size) / 8);
  for (const [name, joint, bytes] of head.columns) {
    const values = new (bytes === 8 ? Float64Array : Float32Array)(buffer, at, head.count);
    if (name === 't') run.t = values; else (run.signals[name] ??= [])[joint] = values;
    at += 8 * Math.ceil(bytes * head.count / 8);
  }
  return run;
}
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
// Packed samples from text of `compressed` in Python: the same columns, as second differences of
// their bits, byte by byte.
async function inflated(text) {
  const packed = bytes(text), size = new DataView(packed).getUint32(0, true);
  const { count, columns } = JSON.parse(new TextDecoder().decode(new Uint8Array(packed, 4, size)));
  const start = 8 * Math.ceil((4 + size) / 8);
  const stream = new Blob([packed.slice(start)]).stream().pipeThrough(
    new DecompressionStream('deflate'));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const places = [];
  let end = start;
  for (const [, , width] of columns) {
    places.push(end);
    end += 8 * Math.ceil(width * count / 8);
  }
  const found = new Uint8Array(end);
  found.set(new Uint8Array(packed, 0, start));
  let at = 0;
  columns.forEach(([, , width], k) => {
    for (let byte = 0; byte < width; byte++, at += count)
      for (let i = 0; i < count; i++) found[places[k] + width * i + byte] = planes[at + i];
    const bits = new (width === 8 ? BigUint64Array : Uint32Array)(found.buffer, places[k], count);
    for (let order = 0; order < 2; order++)
      for (let i = 1; i < count; i++) bits[i] += bits[i - 1];
  });
  return found.buffer;
}
// Signals that are sampled together: their times, and a column for each joint.
class Track {
  constructor({ t, signals }) { Object.assign(this, { t, signals, room: null }); }
  // Columns are the middle of larger arrays, so that an addition seldom copies all.
  append(more) {
    const count = this.t.length, added = more.t.length;
    const full = !this.room || this.room.end + added > this.room.size;
    const kept = full ? Math.min(count, MOST) : count;
    if (full) this.room = { size: kept + added + Math.max(MOST / 2, added), end: kept };
    const { size, end } = this.room;
    const longer = (old, values) => {
      let array = old.room;
      if (full) {
        array = new values.constructor(size);
        array.set(old.subarray(count - kept));
      }
      array.set(values, end);
      const shown = array.subarray(Math.max(0, end + added - MOST), end + added);
      return Object.assign(shown, { room: array });
    };
    this.t = longer(this.t, more.t);
    for (const [name, columns] of Object.entries(more.signals))
      this.signals[name] = columns.map((x, j) => longer(this.signals[name][j], x));
    this.room.end += added;
  }
}
class Run {
  constructor({ name, colour: own, t, signals, packed, received }) {
    this.name = name || '';
    this.colour = own;
    this.received = Boolean(received);
    this.shown = true;
    this.tracks = [];
    for (const part of packed || [])
      this.take(unpacked(part instanceof ArrayBuffer ? part : bytes(part)));
    if (t) this.take({ t, signals, head: {} });
  }
  // Add samples; return whether they are of signals that were not there.
  take(more) {
    const [name] = Object.keys(more.signals);
    const k = this.tracks.findIndex(track => name in track.signals);
    if (k < 0) this.tracks.push(new Track(more));
    else if (more.head.fresh) this.tracks[k] = new Track(more);
    else this.tracks[k].append(more);
    return k < 0;
  }
  // The track with a signal or with what it follows from.
  track(signal) {
    const name = NEEDS[signal] || [signal], others = FOLLOWS[signal];
    return this.tracks.find(({ signals }) => name.some(x => x in signals))
      || this.tracks.find(({ signals }) => others?.every(x => x in signals));
  }
  // Times of reception tell neither rates nor spectra.
  has(signal) {
    return Boolean(this.track(signal)) && !(this.received && NEEDS[signal]?.includes('torque'));
  }
  // Times of a signal, and the function from the number of a sample to its value.
  values(signal, joint) {
    const { t, signals: s } = this.track(signal);
    const line = at => ({ t, at });
    if (signal in s) { const x = s[signal][joint]; return line(i => x[i]); }
    if (signal === 'logV') {
      const x = s.V[0];
      return line(i => (x[i] > 0 ? Math.log10(x[i]) : NaN));
    }
    if (signal in NEEDS) {
      const x = s[NEEDS[signal].find(name => name in s)][joint];
      if (signal === 'applied') return line(i => x[i]);
      return line(i => (i ? (x[i] - x[i - 1]) / (t[i] - t[i - 1]) : NaN));
    }
    const [a, b] = FOLLOWS[signal].map(name => s[name][joint]), sign = signal === 'q_d' ? 1 : -1;
    return line(i => a[i] + sign * b[i]);
  }
  get ends() {
    const times = this.tracks.map(track => track.t).filter(t => t.length);
    return [Math.min(...times.map(t => t[0])), Math.max(...times.map(t => t[t.length - 1]))];
  }
}
