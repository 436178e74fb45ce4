// State of a graph: the light, the nodes' reports, and the answers to requests.
//
//   const status = ctcStatus(light, reports, log);   // elements
//   status.light({level, title, lines, law});
//   status.reports([[node, message, [[key, value], ...]], ...]);
//   status.answers([{clock, request, done, text}, ...]);   // the newest first
'use strict';
const ctcStatus = (light, reports, log) => {
  // While the pointer is in the panel, the light does not shrink, so that nothing moves up under it.
  let tallest = 0, isPointed = false;
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
