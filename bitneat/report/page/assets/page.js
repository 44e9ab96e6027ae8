/* SPDX-License-Identifier: MIT
 *
 * Replays the recorded episodes, lets the controller's compiled C compute every step again, and shows its signals at work.
 */
(function () {
  "use strict";

  const data = JSON.parse(document.getElementById("data").textContent);
  const NUM_INPUTS = data.inputs.length;
  const NUM_SIGNALS = NUM_INPUTS + data.nodes.length;
  const NUM_OUTPUTS = data.outputs.length;
  const ONE = 1 << data.fracBits;
  const SIGNAL_MAX = 32767;
  const byId = (id) => document.getElementById(id);
  const calm = window.matchMedia("(prefers-reduced-motion: reduce)");

  // ---- What was recorded

  function bytes(base64) {
    return Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  }

  /* Little-endian, on any machine. */
  function numbers(base64, size, method) {
    const view = new DataView(bytes(base64).buffer);
    return Array.from({ length: view.byteLength / size }, (_, i) => view[method](size * i, true));
  }

  const int16s = (base64) => Int16Array.from(numbers(base64, 2, "getInt16"));
  const float32s = (base64) => Float32Array.from(numbers(base64, 4, "getFloat32"));

  const episodes = data.episodes.map((one) => ({
    ...one,
    inputs: int16s(one.inputs),
    outputs: int16s(one.outputs),
    rewards: float32s(one.rewards),
    poses: one.poses ? int16s(one.poses) : null,
    signals: null,
  }));

  // ---- The compiled C

  /* A module with one function of the controller, called a step at a time. */
  class Machine {
    static async load(part, content) {
      const { instance } = await WebAssembly.instantiate(content, {});
      return new Machine(part, instance.exports);
    }

    constructor(part, exported) {
      this.part = part;
      this.exported = exported;
      const place = (name, length) => new Int16Array(exported.memory.buffer, exported[name].value, length);
      if (part.entry === "run") {
        this.inputs = this.signals = place("bitneat_signals", data.workspace);
        this.outputs = this.signals.subarray(data.workspace - NUM_OUTPUTS);
        this.addresses = [exported.bitneat_signals.value];
      } else {
        this.inputs = place("bitneat_observation", NUM_INPUTS);
        this.outputs = place("bitneat_action", NUM_OUTPUTS);
        this.addresses = [exported.bitneat_observation.value, exported.bitneat_action.value];
      }
      if (part.stateful) {
        this.addresses.unshift(exported.bitneat_state.value);
      }
    }

    reset() {
      this.exported.bitneat_reset();
    }

    /* What it does not write keeps -32768, which is no signal. */
    step(inputs) {
      (this.signals || this.outputs).fill(-32768);
      this.inputs.set(inputs);
      this.exported[this.part.function](...this.addresses);
    }
  }

  function compare(machine, episode, found, afterStep) {
    machine.reset();
    for (let step = 0; step < episode.steps; step++) {
      machine.step(episode.inputs.subarray(step * NUM_INPUTS, (step + 1) * NUM_INPUTS));
      let equal = true;
      for (let output = 0; output < NUM_OUTPUTS; output++) {
        const expected = episode.outputs[step * NUM_OUTPUTS + output];
        const got = machine.outputs[output];
        if (got !== expected) {
          equal = false;
          found.first = found.first || { seed: episode.seed, step, output, got, expected };
        }
      }
      found.steps += 1;
      found.equal += equal ? 1 : 0;
      if (afterStep) {
        afterStep(step, machine);
      }
    }
  }

  function keepSignals(episode) {
    episode.signals = new Int16Array(episode.steps * NUM_SIGNALS);
    return (step, machine) => {
      for (let signal = 0; signal < NUM_SIGNALS; signal++) {
        episode.signals[step * NUM_SIGNALS + signal] = machine.signals[data.slots[signal]];
      }
    };
  }

  function showVerdict(verdict, badge, text) {
    byId("parity").dataset.verdict = verdict;
    byId("parity-badge").textContent = badge;
    byId("parity-text").textContent = text;
    byId("parity-chip").textContent = badge;
    byId("parity-chip").className = `badge ${{ pass: "good", fail: "bad" }[verdict] || ""}`;
  }

  const count = (number) => number.toLocaleString("en");

  /* All episodes again, by the C that is handed out and by its table style. */
  async function recompute(stepWasm) {
    if (typeof WebAssembly !== "object") {
      showVerdict("unavailable", "not run", "This browser has no WebAssembly, so nothing was computed here.");
      return;
    }
    const found = { steps: 0, equal: 0, first: null };
    const inside = { steps: 0, equal: 0, first: null };
    try {
      const step = await Machine.load(data.modules.step, stepWasm);
      const run = await Machine.load(data.modules.run, bytes(data.modules.run.wasm));
      for (const episode of episodes) {
        compare(step, episode, found, null);
        compare(run, episode, inside, keepSignals(episode));
      }
    } catch (error) {
      // A browser that does not know 'wasm-unsafe-eval' compiles nothing here; that says nothing of the module.
      if (error instanceof WebAssembly.CompileError && /unsafe-eval|Content Security/.test(error.message)) {
        showVerdict("unavailable", "not run", "This browser forbids WebAssembly in this page, so nothing was computed here.");
      } else {
        showVerdict("fail", "failed", `The module does not run: ${error.message}`);
      }
      return;
    }
    const wrong = found.first ? found : inside;
    if (wrong.first) {
      const { seed, step, output, got, expected } = wrong.first;
      const where = `seed ${seed}, step ${step}, ${data.outputs[output].name}: ${got} instead of ${expected}`;
      const whose = found.first ? "" : " in the table style";
      showVerdict("fail", "NOT bit-exact", `${count(wrong.equal)} of ${count(wrong.steps)} steps equal${whose}. First difference: ${where}`);
    } else {
      showVerdict("pass", "bit-exact", `${count(found.equal)} of ${count(found.steps)} steps, every output bit`);
    }
  }

  // ---- A fault to plant: one i32.add of the step made an i32.sub

  const fault = { next: 0 };

  async function plantFault() {
    const additions = data.modules.step.additions;
    const offset = additions[fault.next % additions.length];
    fault.next += 1;
    const content = bytes(data.modules.step.wasm);
    content[offset] = 0x6b;
    await recompute(content);
    byId("repair").hidden = false;
    byId("fault-text").textContent = `One byte changed: the addition at byte ${offset} of ${content.length} is now a subtraction.`;
  }

  function repair() {
    byId("repair").hidden = true;
    byId("fault-text").textContent = "";
    return recompute(bytes(data.modules.step.wasm));
  }

  // ---- Where the reader is

  const now = { episode: 0, step: 0, playing: false, speed: 1, chosen: "", rest: 0, last: 0 };
  const episode = () => episodes[now.episode];

  function seek(step) {
    now.step = Math.max(0, Math.min(episode().steps - 1, Math.round(step)));
    show();
  }

  function play(on) {
    if (on && now.step >= episode().steps - 1) {
      now.step = 0;
    }
    now.playing = on;
    now.last = 0;
    now.rest = 0;
    byId("play").textContent = on ? "Pause" : "Play";
    byId("play").setAttribute("aria-label", on ? "Pause" : "Play");
    if (on) {
      window.requestAnimationFrame(frame);
    }
  }

  function frame(time) {
    if (!now.playing) {
      return;
    }
    if (now.last) {
      now.rest += ((time - now.last) / 1000) * data.framesPerSecond * now.speed;
      const steps = Math.floor(now.rest);
      now.rest -= steps;
      if (steps) {
        seek(now.step + steps);
      }
    }
    now.last = time;
    if (now.step >= episode().steps - 1) {
      play(false);
    } else {
      window.requestAnimationFrame(frame);
    }
  }

  function chooseEpisode(index) {
    now.episode = index;
    byId("scrub").max = episode().steps - 1;
    traces.image = null;
    seek(0);
  }

  function show() {
    const one = episode();
    byId("scrub").value = now.step;
    byId("scrub").setAttribute("aria-valuetext", `step ${now.step} of ${one.steps}, reward ${one.rewards[now.step].toFixed(1)}`);
    byId("step-shown").textContent = count(now.step);
    byId("reward-shown").textContent = one.rewards[now.step].toFixed(1);
    byId("walk").dataset.step = now.step;
    byId("walk").setAttribute("aria-label", `Seed ${one.seed}, step ${now.step} of ${one.steps}`);
    if (one.poses) {
      drawWalk(one, now.step);
    } else {
      drawLines(byId("walk"), inputRows(one), one.steps, now.step);
    }
    drawTraces(one, now.step);
    showSignals(one, now.step);
  }

  // ---- Canvases

  let palette = {};

  function readPalette() {
    const style = window.getComputedStyle(document.documentElement);
    const names = ["ink", "muted", "line", "card", "add", "sub", "third", "fourth", "sky", "soil", "soil-edge", "stone", "hull", "leg-near", "leg-far", "ray"];
    palette = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }

  function prepared(canvas) {
    const scale = window.devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = canvas;
    if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
      canvas.width = Math.round(width * scale);
      canvas.height = Math.round(height * scale);
    }
    const context = canvas.getContext("2d");
    context.setTransform(scale, 0, 0, scale, 0, 0);
    context.clearRect(0, 0, width, height);
    return { context, width, height };
  }

  function pose(one, step) {
    const bodies = one.shapes.length;
    return Array.from({ length: bodies }, (_, body) => {
      const at = (step * bodies + body) * 3;
      return { x: one.poses[at] / data.lengthSteps, y: one.poses[at + 1] / data.lengthSteps, angle: one.poses[at + 2] / data.angleSteps };
    });
  }

  function drawWalk(one, step) {
    const { context, width, height } = prepared(byId("walk"));
    const bodies = pose(one, step);
    const hull = bodies[0];
    // About 10 m are in view; the hull stays a third of the way along, and the ground about it in the lower part.
    const metre = Math.max(Math.min(width / 10.5, height / 5), 26);
    const left = hull.x - (width / metre) * 0.36;
    const bottom = groundAbout(one, hull.x) - (height / metre) * 0.2;
    const X = (x) => (x - left) * metre;
    const Y = (y) => height - (y - bottom) * metre;
    drawGround(context, one, X, Y, width, height);
    drawTrail(context, one, step, X, Y);
    drawRays(context, one, step, hull, X, Y);
    const colours = ["hull", "leg-far", "leg-far", "leg-near", "leg-near"];
    for (const body of [1, 2, 0, 3, 4]) {
      drawBody(context, one.shapes[body], bodies[body], palette[colours[body]], X, Y);
    }
    drawContacts(context, one, step, bodies, X, Y);
  }

  /* Where the hull has been. */
  function drawTrail(context, one, step, X, Y) {
    const size = one.shapes.length * 3;
    context.beginPath();
    for (let at = Math.max(step - 200, 0); at <= step; at++) {
      context.lineTo(X(one.poses[at * size] / data.lengthSteps), Y(one.poses[at * size + 1] / data.lengthSteps));
    }
    context.lineWidth = 1.5;
    context.setLineDash([1, 5]);
    context.lineCap = "round";
    context.strokeStyle = palette.hull;
    context.globalAlpha = 0.7;
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  /* The mean height of the ground within 5 m, which moves the picture smoothly. */
  function groundAbout(one, x) {
    const near = one.ground.filter(([at]) => Math.abs(at - x) < 5);
    return near.reduce((total, [, y]) => total + y, 0) / Math.max(near.length, 1);
  }

  function polygon(context, points) {
    context.beginPath();
    points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.closePath();
  }

  function drawGround(context, one, X, Y, width, height) {
    const line = one.ground.map(([x, y]) => [X(x), Y(y)]);
    const last = line[line.length - 1];
    polygon(context, [[Math.min(line[0][0], 0), height + 2], [Math.min(line[0][0], 0), line[0][1]], ...line, [Math.max(last[0], width), last[1]], [Math.max(last[0], width), height + 2]]);
    context.fillStyle = palette.soil;
    context.fill();
    context.lineWidth = 1.5;
    context.strokeStyle = palette["soil-edge"];
    context.stroke();
    context.fillStyle = palette.stone;
    for (const obstacle of one.obstacles) {
      polygon(context, obstacle.map(([x, y]) => [X(x), Y(y)]));
      context.fill();
    }
    // A mark every ten metres, so that one sees how far it has come.
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "center";
    for (let metres = 0; metres <= 90; metres += 10) {
      const x = X(metres);
      if (x > -20 && x < width + 20) {
        context.fillStyle = palette.ink;
        context.globalAlpha = 0.65;
        context.fillText(`${metres} m`, x, height - 9);
        context.fillRect(x - 0.5, height - 26, 1, 7);
        context.globalAlpha = 1;
      }
    }
  }

  /* The rays as the controller reads them: fractions of 160 / 30 m, from straight down to forwards. */
  function drawRays(context, one, step, hull, X, Y) {
    if (NUM_INPUTS !== 24) {
      return;
    }
    context.lineWidth = 1;
    for (let ray = 0; ray < 10; ray++) {
      const scale = 2 ** (data.fracBits + data.inputs[14 + ray].scale);
      const fraction = one.inputs[step * NUM_INPUTS + 14 + ray] / scale;
      const reach = (160 / 30) * fraction;
      const x = X(hull.x + Math.sin(0.15 * ray) * reach);
      const y = Y(hull.y - Math.cos(0.15 * ray) * reach);
      context.globalAlpha = readInputs.has(14 + ray) ? 0.75 : 0.22;
      context.strokeStyle = palette.ray;
      context.beginPath();
      context.moveTo(X(hull.x), Y(hull.y));
      context.lineTo(x, y);
      context.stroke();
      if (fraction < 1) {
        context.beginPath();
        context.arc(x, y, 2.2, 0, 7);
        context.fillStyle = palette.ray;
        context.fill();
      }
    }
    context.globalAlpha = 1;
  }

  function drawBody(context, shape, body, colour, X, Y) {
    const cos = Math.cos(body.angle);
    const sin = Math.sin(body.angle);
    polygon(context, shape.map(([x, y]) => [X(body.x + cos * x - sin * y), Y(body.y + sin * x + cos * y)]));
    context.lineJoin = "round";
    context.fillStyle = colour;
    context.fill();
    context.lineWidth = 1.5;
    context.strokeStyle = palette.card;
    context.stroke();
  }

  /* A foot that the controller feels on the ground. */
  function drawContacts(context, one, step, bodies, X, Y) {
    if (NUM_INPUTS !== 24) {
      return;
    }
    for (const [body, input] of [[2, 8], [4, 13]]) {
      if (one.inputs[step * NUM_INPUTS + input] > 0) {
        const { x, y, angle } = bodies[body];
        const half = -17 / 30;
        context.beginPath();
        context.arc(X(x - Math.sin(angle) * half), Y(y + Math.cos(angle) * half), 5, 0, 7);
        context.fillStyle = palette.sub;
        context.fill();
        context.lineWidth = 1.5;
        context.strokeStyle = palette.card;
        context.stroke();
      }
    }
  }

  const TONES = ["add", "sub", "third", "fourth"];

  function rowsOf(values, width, indices, names) {
    return indices.map((index, row) => ({
      name: names[index],
      tone: TONES[row % TONES.length],
      at: (step) => values[step * width + index],
    }));
  }

  function inputRows(one) {
    const read = [...readInputs];
    return rowsOf(one.inputs, NUM_INPUTS, read.slice(0, 24), data.inputs.map((entry) => entry.name));
  }

  function outputRows(one) {
    const all = data.outputs.map((_, index) => index);
    return rowsOf(one.outputs, NUM_OUTPUTS, all.slice(0, 8), data.outputs.map((entry) => entry.name));
  }

  const TRACE_LEFT = 84;

  function drawLines(canvas, rows, steps, step) {
    const { context, width, height } = prepared(canvas);
    const row = height / Math.max(rows.length, 1);
    const X = (at) => TRACE_LEFT + (at / Math.max(steps - 1, 1)) * (width - TRACE_LEFT - 2);
    rows.forEach((one, index) => {
      let reach = 1;
      for (let at = 0; at < steps; at++) {
        reach = Math.max(reach, Math.abs(one.at(at)));
      }
      const middle = row * (index + 0.5);
      const Y = (value) => middle - (value / reach) * (row / 2 - 3);
      context.strokeStyle = palette.line;
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(TRACE_LEFT, middle);
      context.lineTo(width, middle);
      context.stroke();
      context.strokeStyle = palette[one.tone];
      context.lineWidth = 1.1;
      context.beginPath();
      for (let at = 0; at < steps; at++) {
        context.lineTo(X(at), Y(one.at(at)));
      }
      context.stroke();
      context.fillStyle = palette.muted;
      context.font = "12px system-ui, sans-serif";
      context.textAlign = "left";
      context.textBaseline = "middle";
      context.fillText(one.name.slice(0, 13), 0, middle);
      context.textBaseline = "alphabetic";
    });
    context.strokeStyle = palette.ink;
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(X(step), 0);
    context.lineTo(X(step), height);
    context.stroke();
  }

  /* The lines stay while the cursor moves: they are drawn once, and copied. */
  const traces = { image: null, key: "" };

  function drawTraces(one, step) {
    const canvas = byId("traces");
    const key = `${now.episode} ${canvas.clientWidth} ${palette.ink}`;
    if (!traces.image || traces.key !== key) {
      drawLines(canvas, outputRows(one), one.steps, -one.steps);
      traces.image = document.createElement("canvas");
      traces.image.width = canvas.width;
      traces.image.height = canvas.height;
      traces.image.getContext("2d").drawImage(canvas, 0, 0);
      traces.key = key;
    }
    const { context, width, height } = prepared(canvas);
    context.drawImage(traces.image, 0, 0, width, height);
    const x = TRACE_LEFT + (step / Math.max(one.steps - 1, 1)) * (width - TRACE_LEFT - 2);
    context.fillStyle = palette.ink;
    context.fillRect(x - 0.5, 0, 1, height);
  }

  function seekByPointer(event) {
    const box = byId("traces").getBoundingClientRect();
    seek(((event.clientX - box.left - TRACE_LEFT) / (box.width - TRACE_LEFT - 2)) * (episode().steps - 1));
  }

  // ---- The drawing of the controller

  const graph = document.querySelector(".graph");
  const boxes = [...graph.querySelectorAll(".box")].map((element) => ({
    element,
    key: element.dataset.key,
    signal: element.dataset.signal === undefined ? null : Number(element.dataset.signal),
    output: element.dataset.output === undefined ? null : Number(element.dataset.output),
    value: element.querySelector(".value"),
    meter: element.querySelector(".meter"),
  }));
  const curves = [...graph.querySelectorAll(".curves path")].map((element) => ({
    element,
    source: Number(element.dataset.source),
    target: element.dataset.target,
    shift: Number(element.dataset.shift),
    delay: Number(element.dataset.delay),
  }));
  const readInputs = new Set(boxes.filter((box) => box.signal !== null && box.signal < NUM_INPUTS && box.output === null).map((box) => box.signal));

  const signed = (value) => (value < 0 ? `−${-value}` : `${value}`);
  const signalKey = (signal) => (signal < NUM_INPUTS ? `x${signal}` : `n${signal - NUM_INPUTS}`);

  /* null where nothing is known: before a signal was computed here. */
  function valueAt(one, step, signal) {
    if (signal < NUM_INPUTS) {
      return step < 0 ? 0 : one.inputs[step * NUM_INPUTS + signal];
    }
    if (!one.signals) {
      return null;
    }
    return step < 0 ? 0 : one.signals[step * NUM_SIGNALS + signal];
  }

  function showSignals(one, step) {
    for (const box of boxes) {
      const value = box.output === null ? valueAt(one, step, box.signal) : one.outputs[step * NUM_OUTPUTS + box.output];
      box.value.textContent = value === null ? "?" : signed(value);
      if (box.meter) {
        const reach = Number(box.meter.dataset.reach) * Math.min(Math.abs(value || 0) / ONE, 1);
        box.meter.setAttribute("width", reach);
        box.meter.setAttribute("x", Number(box.meter.dataset.middle) - (value < 0 ? reach : 0));
        box.meter.classList.toggle("negative", value < 0);
      }
    }
    for (const curve of curves) {
      const value = valueAt(one, step - curve.delay, curve.source) || 0;
      const part = Math.min((Math.abs(value) * 2 ** curve.shift) / ONE, 1);
      curve.element.style.strokeOpacity = value ? 0.2 + 0.8 * Math.sqrt(part) : 0.12;
      curve.element.style.strokeWidth = 1 + 2.4 * part;
    }
    showFormula(one, step);
  }

  /* What leads to a box and from it; an output stands for the node that it shows. */
  function choose(key, dimOthers = true) {
    now.chosen = key;
    const shown = boxes.find((box) => box.key === key);
    const keys = shown && shown.signal !== null ? [key, signalKey(shown.signal)] : [key];
    for (const box of boxes) {
      box.element.classList.toggle("chosen", box.key === key);
    }
    const near = (curve) => keys.includes(curve.target) || (keys.includes(signalKey(curve.source)) && curve.target !== key);
    graph.classList.toggle("choosing", dimOthers && curves.some(near));
    for (const curve of curves) {
      curve.element.classList.toggle("near", near(curve));
    }
    show();
  }

  function element(tag, name, ...children) {
    const made = document.createElement(tag);
    made.className = name;
    made.append(...children);
    return made;
  }

  function showFormula(one, step) {
    const box = boxes.find((candidate) => candidate.key === now.chosen);
    const parts = !box ? hint() : box.key[0] === "x" ? inputFormula(one, step, box.signal) : box.key[0] === "y" ? outputFormula(one, step, box) : nodeFormula(one, step, box.signal);
    byId("formula").replaceChildren(...parts);
  }

  function hint() {
    return [element("div", "head", "Choose a node to see what it adds and subtracts at this step.")];
  }

  function inputFormula(one, step, signal) {
    const { name, scale, limit } = data.inputs[signal];
    const value = valueAt(one, step, signal);
    const about = (value / 2 ** (data.fracBits + scale)).toFixed(3).replace("-", "−");
    return [
      element("div", "head", element("b", "", `x${signal}`), ` input, ${name}`),
      element("div", "sum", `clip(rint(observation · 2^${data.fracBits + scale}), ±${limit})`),
      element("div", "", `= ${signed(value)}, about ${about}`),
    ];
  }

  function outputFormula(one, step, box) {
    const { name, signal } = data.outputs[box.output];
    const value = one.outputs[step * NUM_OUTPUTS + box.output];
    const head = element("div", "head", element("b", "", `y${box.output}`), ` output, ${name}`);
    let text = `y${box.output} = ${signal === undefined ? "constant" : signalKey(signal)} = ${signed(value)}`;
    if (data.action) {
      const low = data.action.low[box.output];
      const high = data.action.high[box.output];
      const action = low + ((Math.max(-1, Math.min(1, value / ONE)) + 1) / 2) * (high - low);
      text += ` → action ${action.toFixed(3).replace("-", "−")}`;
    } else {
      const row = one.outputs.subarray(step * NUM_OUTPUTS, (step + 1) * NUM_OUTPUTS);
      text += row.indexOf(Math.max(...row)) === box.output ? ", the largest: chosen" : ", not the largest";
    }
    const inner = signal === undefined || signal < NUM_INPUTS ? [] : nodeFormula(one, step, signal).slice(1);
    return [head, ...inner, element("div", "", text)];
  }

  /* The sum is computed here, from the values that the C gave its sources. */
  function nodeFormula(one, step, signal) {
    const node = data.nodes[signal - NUM_INPUTS];
    const terms = node.links.map(([source, sign, shift, delay]) => {
      const value = valueAt(one, step - delay, source);
      const factor = shift ? `${2 ** shift}·` : "";
      return { text: `${sign > 0 ? "+" : "−"}${factor}${signalKey(source)}${delay ? "′" : ""}`, value: value === null ? null : sign * value * 2 ** shift, sign };
    });
    if (node.bias || !terms.length) {
      terms.push({ text: "bias", value: node.bias, sign: Math.sign(node.bias) });
    }
    const known = terms.every((term) => term.value !== null);
    const sum = terms.reduce((total, term) => total + term.value, 0);
    const scaled = Math.floor(sum * 2 ** node.gain);
    const clipped = Math.max(-SIGNAL_MAX, Math.min(SIGNAL_MAX, scaled));
    let text = known ? `acc = ${signed(sum)}` : "acc: not known, as WebAssembly did not run";
    if (known && node.gain) {
      text += node.gain > 0 ? ` → ×${2 ** node.gain} = ${signed(scaled)}` : ` → ÷${2 ** -node.gain}, floor = ${signed(scaled)}`;
    }
    if (known && clipped !== scaled) {
      text += ` → clip = ${signed(clipped)}`;
    }
    if (known) {
      text += node.activation === "identity" ? "" : ` → ${node.activation}`;
      text += ` ⇒ ${signalKey(signal)} = ${signed(valueAt(one, step, signal))}`;
    }
    const shown = terms.map((term) =>
      element("div", `term ${term.sign > 0 ? "add" : term.sign < 0 ? "sub" : ""}`, element("span", "", term.text), element("b", "", term.value === null ? "?" : signed(term.value))),
    );
    return [
      element("div", "head", element("b", "", signalKey(signal)), ` node, ${node.activation}`),
      element("div", "sum", ...shown),
      element("div", "result", text),
    ];
  }

  // ---- Charts of the run

  function followPointer(figure) {
    const rows = [...figure.querySelectorAll(".rows li")];
    if (!rows.length) {
      return;
    }
    const svg = figure.querySelector("svg");
    const cursor = figure.querySelector(".cursor");
    let index = rows.length - 1;
    const read = (wanted) => {
      index = Math.max(0, Math.min(rows.length - 1, wanted));
      figure.querySelector(".readout").textContent = rows[index].textContent;
      cursor.setAttribute("x1", rows[index].dataset.at);
      cursor.setAttribute("x2", rows[index].dataset.at);
    };
    const point = (event) => {
      const box = svg.getBoundingClientRect();
      const at = ((event.clientX - box.left) / box.width) * svg.viewBox.baseVal.width;
      const distances = rows.map((row) => Math.abs(Number(row.dataset.at) - at));
      read(distances.indexOf(Math.min(...distances)));
    };
    svg.addEventListener("pointermove", point);
    svg.addEventListener("pointerdown", point);
    svg.addEventListener("keydown", (event) => {
      const move = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (move) {
        event.preventDefault();
        event.stopPropagation();
        read(index + move);
      }
    });
  }

  // ---- Beginning

  function onKey(event) {
    const field = event.target.closest("input, select, button, summary, a, pre, .scroll, .box, figure");
    const moves = { ArrowLeft: -1, ArrowRight: 1 };
    if (field || event.ctrlKey || event.metaKey || event.altKey) {
      return;
    }
    if (event.key === " ") {
      play(!now.playing);
    } else if (event.key in moves) {
      seek(now.step + moves[event.key] * (event.shiftKey ? 10 : 1));
    } else if (event.key === "Home" || event.key === "End") {
      seek(event.key === "Home" ? 0 : Infinity);
    } else {
      return;
    }
    event.preventDefault();
  }

  function setTheme(theme) {
    document.documentElement.dataset.theme = theme;
    readPalette();
    traces.image = null;
    show();
  }

  function isDark() {
    const named = document.documentElement.dataset.theme;
    return named ? named === "dark" : window.matchMedia("(prefers-color-scheme: dark)").matches;
  }

  function connect() {
    byId("play").addEventListener("click", () => play(!now.playing));
    byId("back").addEventListener("click", () => seek(now.step - 1));
    byId("forward").addEventListener("click", () => seek(now.step + 1));
    byId("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
    byId("episode").addEventListener("change", (event) => chooseEpisode(Number(event.target.value)));
    byId("speed").addEventListener("change", (event) => (now.speed = Number(event.target.value)));
    byId("traces").addEventListener("pointerdown", seekByPointer);
    byId("traces").addEventListener("pointermove", (event) => event.buttons && seekByPointer(event));
    byId("theme").addEventListener("click", () => setTheme(isDark() ? "light" : "dark"));
    byId("fault").addEventListener("click", () => plantFault().then(show));
    byId("repair").addEventListener("click", () => repair().then(show));
    for (const box of boxes) {
      box.element.addEventListener("pointerenter", () => choose(box.key));
      box.element.addEventListener("focus", () => choose(box.key));
      box.element.addEventListener("click", () => choose(box.key));
    }
    graph.addEventListener("pointerleave", () => choose(now.chosen, false));
    document.addEventListener("keydown", onKey);
    window.addEventListener("resize", show);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      readPalette();
      traces.image = null;
      show();
    });
    document.querySelectorAll(".chart").forEach(followPointer);
  }

  async function begin() {
    readPalette();
    connect();
    const output = boxes.find((box) => box.output !== null && box.signal !== null && box.signal >= NUM_INPUTS);
    now.chosen = output ? output.key : "";
    chooseEpisode(0);
    await recompute(bytes(data.modules.step.wasm));
    byId("fault").hidden = !data.modules.step.additions.length;
    choose(now.chosen, false);
    document.documentElement.dataset.ready = "true";
    if (!calm.matches) {
      play(true);
    }
  }

  begin();
})();
