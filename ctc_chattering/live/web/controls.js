// The controls of a running graph: law, gains, torques, recording, plant. See controls.py.
//
//   const update = ctcControls(parent, send);   // send(words) asks for something
//   update(state);                              // what `Controls.state` returns
'use strict';
const ctcControls = (parent, send) => {
  const element = (tag, into, name = '', text = '') => {
    const made = document.createElement(tag);
    made.className = name;
    made.textContent = text;
    into.append(made);
    return made;
  };
  const bar = (into, name) => {
    const made = element('div', into, 'ctc-bar');
    element('span', made, '', name);
    return made;
  };
  const button = (into, text, clicked) => {
    const made = element('button', into, '', text);
    made.type = 'button';
    made.onclick = clicked;
    return made;
  };
  const folded = title => {
    const details = element('details', parent);
    element('summary', details, '', title);
    return details;
  };
  const digits = x => String(Number(x.toPrecision(4)));
  let state = null;

  // --- fields: what they cannot be is marked at once, with the reason below
  function field(into, label, reason) {
    const row = element('label', into), title = element('span', row, '', label);
    const input = element('input', row);
    const why = element('span', row, 'ctc-wrong');
    input.setAttribute('aria-label', label);
    const wrong = () => {
      const text = reason(input.value.trim());
      input.setAttribute('aria-invalid', String(Boolean(text)));
      why.textContent = text;
      return text;
    };
    input.addEventListener('input', wrong);
    return { row, title, input, wrong };
  }
  const wordsOf = text => text.replace(/[[\],]/g, ' ').split(/\s+/).filter(Boolean);
  function numbersReason(text, count, least = -Infinity, most = Infinity) {
    const words = wordsOf(text), values = words.map(Number);
    if (![1, count].includes(words.length))
      return count > 1 ? `one number, or ${count}` : 'one number';
    const odd = values.findIndex(x => !Number.isFinite(x));
    if (odd >= 0) return `${words[odd]} is no number`;
    if (values.some(x => x < least || x > most)) return `allowed: ${least} to ${most}`;
    return '';
  }

  // --- law, switching: the one in force is pressed
  function choice(name) {
    const buttons = new Map(), row = bar(parent, name);
    return (value, choices) => {
      row.hidden = value === null;
      for (const each of choices) {
        if (!buttons.has(each)) buttons.set(each, button(row, each, () => send({ [name]: each })));
        buttons.get(each).setAttribute('aria-pressed', String(each === value));
      }
    };
  }
  const law = choice('law'), switching = choice('switching');

  // --- gains: sliders of the logarithm, sent on release, and numbers, sent on Enter
  const gains = folded('gains'), gainBar = bar(gains, 'of'), joints = element('select', gainBar);
  joints.setAttribute('aria-label', 'gains of');
  joints.title = 'all joints: a slider has the largest value, and the others keep their ratios;'
    + ' its number is one for all, or one for each joint';
  const grid = element('div', gains, 'ctc-fields'), sliders = new Map();
  const chosen = () => Number(joints.value);
  // The values that a slider and its number are of: of one joint, or of all.
  const inForce = ({ values }) => (values.length > 1 && chosen() >= 0 ? [values[chosen()]]
    : values);
  const listed = values => (new Set(values).size > 1 ? values : values.slice(0, 1))
    .map(digits).join(', ');
  function slider(name) {
    const it = { ...field(grid, `${name} as a number`, text => numbersReason(
      text, inForce(it.gain).length, ...it.gain.bounds)), slide: document.createElement('input') };
    const { slide, input, wrong, title } = it;
    Object.assign(it, { asked: null, held: false });
    Object.assign(slide, { type: 'range', min: 0, max: 1, step: 'any' });
    title.after(slide);
    const value = () => Number((it.gain.least
      * (it.gain.most / it.gain.least) ** Number(slide.value)).toPrecision(3));
    const ask = words => {
      it.held = false;
      it.asked = { answered: state.answered, at: Date.now() };
      send(words);
    };
    const joint = () => (it.gain.values.length > 1 ? chosen() : -1);
    const askOne = asked => ask({ gain: { name, joint: joint(), value: asked } });
    slide.setAttribute('aria-label', name);
    input.inputMode = 'decimal';
    slide.oninput = () => { it.held = true; input.value = digits(value()); wrong(); };
    slide.onchange = () => askOne(Math.min(it.gain.most, Math.max(it.gain.least, value())));
    input.addEventListener('input', () => { it.held = true; });
    input.onchange = () => {
      if (wrong()) return;
      const values = wordsOf(input.value).map(Number);
      if (joint() < 0 && it.gain.values.length > 1) ask({ gains: { name, values } });
      else askOne(values[0]);
    };
    input.onblur = slide.onblur = () => { it.held = false; place(it); };
    sliders.set(name, it);
    return it;
  }
  // Put a slider where the value in force is, unless it is held or its answer is awaited.
  function place(it) {
    const { gain, asked, slide, input, row, title } = it, values = inForce(gain);
    const value = Math.max(...values);
    row.title = gain.about;
    title.textContent = `${gain.name} [${gain.unit}]`;
    if (asked && (state.answered > asked.answered || Date.now() - asked.at > 5000)) it.asked = null;
    if (it.held || it.asked) return;
    slide.value = value > 0 ? Math.log(value / gain.least) / Math.log(gain.most / gain.least) : 0;
    input.value = listed(values);
    row.classList.toggle('ctc-several', input.value.includes(','));
    it.wrong();
  }
  joints.onchange = () => sliders.forEach(place);

  // --- torques, recording
  const torques = bar(parent, 'torques');
  button(torques, 'reset and enable', () => send({ torques: true })).title =
    'calls ~/reset, then ~/enable';
  button(torques, 'disable', () => send({ torques: false }));
  const bag = bar(parent, 'bag'), record = button(
    bag, '', () => send({ record: state.record.state === 'off' }));
  const where = element('span', bag, 'ctc-where');
  const LABELS = { off: '● record', starting: 'starting …', on: '■ stop recording',
    stopping: 'stopping …' };

  // --- plant: friction and disturbance, a push, simulated time
  const plant = folded('friction and disturbance');
  const plantGrid = element('div', plant, 'ctc-fields'), fields = new Map();
  button(bar(plant, ''), 'apply changes', () => {
    for (const [parameter, { input, wrong, shown }] of fields)
      if (!wrong() && input.value.trim() !== shown) send({ plant: { name: parameter,
        value: wordsOf(input.value).map(Number) } });
  });
  const push = folded('push'), pushGrid = element('div', push, 'ctc-fields');
  const number = (into, label, value, ...limits) => {
    const it = field(into, label, text => numbersReason(text, 1, ...limits));
    it.input.value = value;
    return it;
  };
  const pushBar = bar(push, 'on'), pushed = element('select', pushBar);
  pushed.setAttribute('aria-label', 'push on');
  const torque = number(pushGrid, 'torque [N·m]', 50);
  const lasts = number(pushGrid, 'duration [s]', 0.2, 0, 10);
  button(pushBar, 'push', () => {
    if (!torque.wrong() && !lasts.wrong()) send({ push: { joint: Number(pushed.value),
      torque: Number(torque.input.value), lasts: Number(lasts.input.value) } });
  });
  const time = folded('simulated time'), timeBar = bar(time, '');
  const steps = number(element('div', time, 'ctc-fields'), 'samples a step', 1, 1, 100000);
  const timeButtons = ['hold', 'step', 'run'].map(word => button(timeBar, word, () => {
    if (!steps.wrong()) send({ time: { word, samples: Math.round(Number(steps.input.value)) } });
  }));
  const reason = element('p', time, 'ctc-where ctc-reason');

  function options(select, texts, first) {
    if (texts.join('\n') === [...select.options].map(x => x.text).join('\n')) return;
    select.replaceChildren();
    texts.forEach((text, i) => { element('option', select, '', text).value = first + i; });
  }
  return now => {
    state = now;
    parent.hidden = false;
    law(state.law, state.laws.includes(state.law) || !state.law ? state.laws
      : [...state.laws, state.law]);
    switching(state.switching, state.switchings);
    options(joints, ['all joints', ...state.joints], -1);
    options(pushed, state.joints, 0);
    gains.hidden = !state.gains.length;
    const known = new Set(state.gains.map(x => x.name));
    for (const [gain, it] of sliders) it.row.hidden = !known.has(gain);
    for (const gain of state.gains) {
      const it = sliders.get(gain.name) || slider(gain.name);
      it.gain = gain;
      place(it);
    }
    const { state: phase, path, lasts: duration } = state.record;
    record.textContent = LABELS[phase];
    record.disabled = phase === 'starting' || phase === 'stopping';
    record.setAttribute('aria-pressed', String(phase === 'on'));
    where.textContent = phase === 'off' ? `in ${path}` : `${path}, ${duration} s`;
    plant.hidden = push.hidden = !state.plant.length;
    for (const { name: parameter, title, value } of state.plant) {
      if (!fields.has(parameter)) fields.set(parameter, field(
        plantGrid, title, text => numbersReason(text, state.joints.length)));
      const it = fields.get(parameter);
      if (it.shown !== value) {
        it.shown = it.input.value = value;
        it.wrong();
      }
    }
    for (const it of timeButtons) it.disabled = Boolean(state.held);
    reason.textContent = state.held;
  };
};
