// State of a graph: the light, the nodes' reports, and the answers to requests.
//
//   const status = ctcStatus(light, reports, log, passes);   // elements
//   status.light({level, title, lines, law});
//   status.reports([[node, message, [[key, value], ...]], ...]);
//   status.passes({learning, pass, 'pass error'});   // values of a reference that learns, or {}
//   status.answers([{clock, request, done, text}, ...]);   // the newest first
'use strict';
const ctcStatus = (light, reports, log, passes) => {
  // While the pointer is in the panel, the light does not shrink, so that nothing moves up under it.
  let tallest = 0, isPointed = false;
  const errors = new Map();  // By pass, as long as the page is open.
  const MAX_PASSES = 100;
  for (const kind of ['pointerenter', 'pointerleave'])
    light?.parentElement.addEventListener(kind, () => { isPointed = kind === 'pointerenter'; });
  return {
    light({ level, title, lines, law }) {
      light.dataset.level = level;
      light.replaceChildren();
      ctcElement('b', light, title);
      if (law) ctcElement('div', light, law, 'ctc-law');
      for (const line of lines) ctcElement('div', light, line);
      light.style.minHeight = '';
      tallest = isPointed ? Math.max(tallest, light.clientHeight) : light.clientHeight;
      light.style.minHeight = `${tallest}px`;
    },
    reports(nodes) {
      reports.replaceChildren();
      for (const [node, message, values] of nodes) {
        const head = ctcElement('p', reports);
        ctcElement('b', head, node);
        head.append(`: ${message}`);
        const table = ctcElement('table', reports, '', 'ctc-reports');
        for (const pair of values) {
          const row = ctcElement('tr', table);
          for (const text of pair) ctcElement('td', row, text);
        }
      }
    },
    passes({ learning, pass, 'pass error': error }) {
      passes.hidden = !learning;
      if (!learning) return;
      const number = Number(pass), size = Number(error);
      for (const past of errors.keys()) if (past > number) errors.delete(past);  // After a reset.
      if (size > 0) errors.set(number, size);
      if (errors.size > MAX_PASSES) errors.delete(errors.keys().next().value);
      passes.replaceChildren();
      ctcElement('b', passes, number ? `pass ${number}: ${size.toExponential(1)} rad` : 'pass 1');
      passes.append(` · ${learning}`);
      if (errors.size < 2) return;
      const decades = [...errors.values()].map(Math.log10);
      const top = Math.max(...decades), range = Math.max(top - Math.min(...decades), 0.5);
      const points = decades.map((y, i) =>
        `${(2 + 196 * i / (errors.size - 1)).toFixed(1)},${(2 + 26 * (top - y) / range).toFixed(1)}`);
      passes.insertAdjacentHTML('beforeend', `<svg viewBox="0 0 200 30" role="img" aria-label="error \
by pass, from ${errors.values().next().value.toExponential(1)} rad"><polyline points="${points.join(' ')}"/></svg>`);
    },
    answers(answers) {
      log.hidden = false;
      log.replaceChildren();
      for (const { clock, request, done, text } of answers) {
        const line = ctcElement('div', log, `${done ? '✓' : '✗'} ${clock} `,
          done ? '' : 'ctc-refused');
        ctcElement('b', line, request);
        line.append(`: ${text}`);
      }
    },
  };
};
