// The controls of a running graph: law, gains, recording, a picture of the view.
// `send` takes an object for the server, `frame` is the iframe of the view; see law_panel.py.
function controls(parent, send, frame) {
  'use strict';
  const element = (tag, into, name, text) => {
    const it = document.createElement(tag);
    if (name) it.className = name;
    if (text !== undefined) it.textContent = text;
    into.append(it);
    return it;
  };
  parent.classList.add('ctc-plots', 'ctc-controls');
  const box = element('div', parent);  // Of a graph that may be changed.
  box.hidden = true;
  const row = name => {
    const it = element('div', box, 'ctc-bar');
    element('span', it, '', name);
    return it;
  };
  const digits = x => String(Number(x.toPrecision(4)));

  // --- law, switching: the one in force is pressed
  function choice(name) {
    const bar = row(name), buttons = new Map();
    return (value, choices) => {
      bar.hidden = value === null;
      for (const each of choices) {
        if (!buttons.has(each)) {
          const button = element('button', bar, '', each);
          button.onclick = () => send({ [name]: each });
          buttons.set(each, button);
        }
        buttons.get(each).setAttribute('aria-pressed', String(each === value));
      }
    };
  }
  const law = choice('law'), switching = choice('switching');

  // --- gains: sliders of the logarithm, sent on release, and numbers, sent on Enter
  const gainBar = row('gains of'), joints = element('select', gainBar);
  joints.setAttribute('aria-label', 'gains of');
  joints.title = 'all joints: their values keep their ratios; the largest is shown';
  const grid = element('div', box, 'ctc-gains'), sliders = new Map();
  let state = null;
  const chosen = () => Number(joints.value);
  function inForce(gain) {
    return gain.values.length > 1 && chosen() >= 0 ? gain.values[chosen()]
      : Math.max(...gain.values);
  }
  function slider(name) {
    const label = element('label', grid), title = element('span', label);
    const input = element('input', label), shown = element('input', label);
    const it = { name, title, input, shown, label, asked: null, held: false };
    input.type = 'range'; input.min = 0; input.max = 1; input.step = 'any';
    const value = () => Number((it.gain.least
      * (it.gain.most / it.gain.least) ** Number(input.value)).toPrecision(3));
    const ask = asked => {
      it.held = false;
      it.asked = { answered: state.answered, at: Date.now() };
      send({ gain: { name, joint: it.gain.values.length > 1 ? chosen() : -1, value: asked } });
    };
    input.setAttribute('aria-label', name);
    shown.setAttribute('aria-label', `${name} as a number`);
    shown.inputMode = 'decimal';
    input.oninput = () => { it.held = true; shown.value = digits(value()); };
    input.onchange = () => ask(Math.min(it.gain.most, Math.max(it.gain.least, value())));
    shown.oninput = () => { it.held = true; };
    shown.onchange = () => {
      if (shown.value.trim() && Number.isFinite(Number(shown.value))) ask(Number(shown.value));
    };
    shown.onblur = input.onblur = () => { it.held = false; place(it); };
    sliders.set(name, it);
    return it;
  }
  // Put a slider where the value in force is, unless it is held or its answer is awaited.
  function place(it) {
    const { gain, asked, input } = it;
    const value = inForce(gain), each = gain.each || chosen() < 0 || gain.values.length === 1;
    const why = gain.off || (each ? '' : 'a full matrix: it is changed for all joints together');
    input.disabled = it.shown.disabled = Boolean(why);
    it.label.title = why || gain.about;
    it.title.textContent = `${gain.name} [${gain.unit}]`;
    if (asked && (state.answered > asked.answered || Date.now() - asked.at > 5000)) it.asked = null;
    if (it.held || it.asked) return;
    input.value = value > 0 ? Math.log(value / gain.least) / Math.log(gain.most / gain.least) : 0;
    it.shown.value = digits(value);
  }
  const placeAll = () => sliders.forEach(place);
  joints.onchange = placeAll;

  // --- recording, picture
  const tools = row('bag'), name = element('input', tools, 'ctc-bag'), record = element(
    'button', tools), where = element('span', tools, 'ctc-where');
  name.placeholder = 'name by the time'; name.maxLength = 64;
  name.setAttribute('aria-label', 'name of the bag');
  record.onclick = () => send({ record: state.record.state === 'off' ? name.value.trim() : null });
  const LABELS = { off: '● record', starting: 'starting …', on: '■ stop recording',
    stopping: 'stopping …' };
  const picture = element('button', element('div', parent, 'ctc-bar'), '', 'picture of the arm');
  picture.onclick = () => frame.contentDocument.querySelector('canvas[data-engine]').toBlob(blob => {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(blob);
    link.download = `arm_${new Date().toISOString().slice(0, 19).replace(/:/g, '.')}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  });
  const log = element('div', box, 'ctc-answers');
  log.setAttribute('aria-live', 'polite');

  return now => {
    state = now;
    box.hidden = false;
    law(state.law, state.laws.includes(state.law) || !state.law ? state.laws
      : [...state.laws, state.law]);
    switching(state.switching, state.switchings);
    const options = ['all joints', ...state.joints];
    if (options.join('\n') !== [...joints.options].map(x => x.text).join('\n')) {
      joints.replaceChildren();
      options.forEach((text, i) => { element('option', joints, '', text).value = i - 1; });
    }
    gainBar.hidden = !state.gains.length;
    const known = new Set(state.gains.map(x => x.name));
    for (const it of sliders.values()) it.label.hidden = !known.has(it.name);
    for (const gain of state.gains) {
      const it = sliders.get(gain.name) || slider(gain.name);
      it.gain = gain;
    }
    state.gains.forEach(gain => place(sliders.get(gain.name)));
    const { state: phase, path, lasts } = state.record;
    record.textContent = LABELS[phase];
    record.disabled = phase === 'starting' || phase === 'stopping';
    record.setAttribute('aria-pressed', String(phase === 'on'));
    name.disabled = phase !== 'off';
    where.textContent = phase === 'off' ? `in ${path}` : `${path}, ${lasts} s`;
    log.replaceChildren();
    for (const { what, done, text, at } of state.answers) {
      const line = element('div', log, done ? '' : 'ctc-refused', `${done ? '✓' : '✗'} ${at} `);
      element('b', line, '', what);
      line.append(`: ${text}`);
    }
  };
}
