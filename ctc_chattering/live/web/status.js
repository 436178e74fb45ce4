// Whether all is well with a graph: the light, what its nodes report, and what became of requests.
//
//   const status = ctcStatus(light, reports, log);   // elements
//   status.light({level, sign, lines, law}); status.reports([[name, message, [[key, value],
//   ...]], ...]); status.answers([{at, what, done, text}, ...]);   // the newest first
'use strict';
const ctcStatus = (light, reports, log) => {
  const element = (tag, into, text = '', name = '') => {
    const made = document.createElement(tag);
    made.className = name;
    made.textContent = text;
    into.append(made);
    return made;
  };
  // While the pointer is in the panel, the light does not shrink: what is below does not move up.
  let tallest = 0, isPointed = false;
  for (const kind of ['pointerenter', 'pointerleave'])
    light?.parentElement.addEventListener(kind, () => { isPointed = kind === 'pointerenter'; });
  return {
    light({ level, sign, lines, law }) {
      light.dataset.level = level;
      light.replaceChildren();
      element('b', light, sign);
      if (law) element('div', light, law, 'ctc-law');
      for (const line of lines) element('div', light, line);
      light.style.minHeight = '';
      tallest = isPointed ? Math.max(tallest, light.clientHeight) : light.clientHeight;
      light.style.minHeight = `${tallest}px`;
    },
    reports(nodes) {
      reports.replaceChildren();
      for (const [name, message, values] of nodes) {
        const head = element('p', reports);
        element('b', head, name);
        head.append(`: ${message}`);
        const table = element('table', reports, '', 'ctc-reports');
        for (const pair of values) {
          const row = element('tr', table);
          for (const text of pair) element('td', row, text);
        }
      }
    },
    answers(found) {
      log.hidden = false;
      log.replaceChildren();
      for (const { at, what, done, text } of found) {
        const line = element('div', log, `${done ? '✓' : '✗'} ${at} `, done ? '' : 'ctc-refused');
        element('b', line, what);
        line.append(`: ${text}`);
      }
    },
  };
};
