// Numbers of all joints at a time, in a table for each run: live.html and export.html.
//
//   const numbers = ctcNumbers(parent, joints);
//   numbers(runs, about, t, 0, remark);   // at a time [s]; runs of ctcPlots
//   numbers(runs, about, null, silent);   // the last ones, after `silent` seconds without any
//   numbers.value(run, signal, joint, t)  // a signal of a run at a time
//
// about = [{name, laws: [[t, law], ...]}, ...] has the name of each run, and its laws with the times
// from which on they are in force. A running graph has neither.
'use strict';
// Append an element to a parent. The other scripts use it as well.
const ctcElement = (tag, parent, text = '', name = '') => {
  const element = document.createElement(tag);
  element.textContent = text;
  if (name) element.className = name;
  parent.append(element);
  return element;
};
const ctcNumbers = (parent, joints) => {
  const MAX_AGE_S = 0.5;  // Older numbers are grey, and have their age.
  const COLUMNS = ['joint', 'q', 'q_d', 'error', 'RMS, 1 s', 'v', 'torque'];
  const PARTS = ['nominal', 'compensation', 'robust'];
  // Index of the last sample at or before a time, else of the first one.
  function index(t, at) {
    let low = 0, high = t.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (t[middle] <= at + 5e-7) low = middle; else high = middle - 1;
    }
    return low;
  }
  // Value of a signal at that sample, and its time.
  function sample(run, signal, joint, time) {
    if (!run.has(signal)) return { value: NaN, t: NaN };
    const { t, at } = run.values(signal, joint), i = index(t, time);
    return { value: t.length ? at(i) : NaN, t: t[i] };
  }
  // Torque of the law, or where it is old, the one that the robot reports.
  function torque(run, joint, time) {
    if (run.has('torque')) return sample(run, 'torque', joint, time);
    const parts = PARTS.map(part => sample(run, part, joint, time));
    return time - parts[0].t > MAX_AGE_S ? sample(run, 'effort', joint, time)
      : { value: parts.reduce((sum, part) => sum + part.value, 0), t: parts[0].t };
  }
  function rms(run, joint, time) {
    if (!run.has('e')) return { value: NaN, t: NaN };
    const { t, at } = run.values('e', joint), last = index(t, time);
    let sum = 0, count = 0;
    for (let i = last; i >= 0 && t[i] > t[last] - 1; i--) { sum += at(i) ** 2; count++; }
    return { value: Math.sqrt(sum / count), t: t[last] };
  }
  const text = (x, written) => (Number.isFinite(x) ? written(x) : '–');
  function cells(run, joint, time) {
    const angle = x => x.toFixed(4), small = x => x.toExponential(2);
    return [
      [sample(run, 'q', joint, time), angle], [sample(run, 'q_d', joint, time), angle],
      [sample(run, 'e', joint, time), small], [rms(run, joint, time), small],
      [sample(run, 'v', joint, time), small], [torque(run, joint, time), x => x.toFixed(1)]];
  }
  const lawAt = (laws, t) => (laws.filter(([at]) => at <= t + 1e-6).pop() || laws[0])[1];
  const show = (runs, about, t = null, silent = 0, remark = '') => {
    parent.replaceChildren();
    runs.forEach((run, r) => {
      const end = run.ends[1], now = t ?? end;
      if (!Number.isFinite(end)) return;
      const head = ctcElement('p', parent), table = ctcElement('table', parent, '', 'ctc-numbers');
      const { name, laws } = about[r];
      if (name) ctcElement('b', head, `${name}: ${lawAt(laws, now)}, `);
      head.append('t = ');
      ctcElement('span', head, now.toFixed(3), 'ctc-now');
      head.append(remark ? ` s, ${remark}` : ' s');
      const names = ctcElement('tr', table);
      for (const column of COLUMNS) ctcElement('th', names, column);
      let oldest = 0;
      joints.forEach((joint, j) => {
        const row = ctcElement('tr', table);
        ctcElement('td', row, joint);
        for (const [{ value, t: at }, written] of cells(run, j, now)) {
          const age = (t ?? silent + end) - at;
          ctcElement('td', row, text(value, written), age > MAX_AGE_S ? 'ctc-old' : '');
          if (age > oldest) oldest = age;
        }
      });
      if (oldest > MAX_AGE_S) ctcElement('span', head, `. Grey numbers are up to ${oldest.toFixed(1)} s old.`, 'ctc-old');
    });
  };
  return Object.assign(show, {
    value: (run, signal, joint, t) => sample(run, signal, joint, t).value });
};
