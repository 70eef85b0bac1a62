"use strict";
/* The page: controls, picture, and the messages to a worker, in which all steps run. */

/* ---- the worker: its text, with the classes of kernel.js, becomes a Blob, which works in files, too ------------- */

function work() {
  const TIMED_STEPS = 20, TIME_EVERY = 500, QUICK = 5, REFERENCE = 1e-13, TRIAL_STEPS = 100;
  const arms = {};
  let now = null; // the arm, its simulators and its movers
  let numbers = {}, timedAt = 0, microseconds = null;

  const state = (simulator, lane) => [simulator.coordinates, simulator.rates].map(
    (names) => names.map((name) => simulator.get(name, lane)));
  const goalOf = (simulator) => [simulator.get("goal_x"), simulator.get("goal_y")];

  /* A mover: begin(simulator, lane) when there is a new goal, act(simulator, lane) in every step. */
  const movers = {
    learner: (arm, policy) => {
      const { weights, ...about } = arm.about.policies[policy];
      const learned = new Policy({ ...about, weights });
      return { begin() {}, act: (simulator, lane) => learned.act(simulator.observation(lane)) };
    },
    torque: (arm) => {
      const model = new Simulator(arm.about.description, arm.module), controller = new ComputedTorque(model);
      return {
        model, begin: (simulator, lane) => controller.begin(state(simulator, lane)[0], goalOf(simulator)),
        act: (simulator, lane) => controller.act(...state(simulator, lane)),
      };
    },
    nobody: (arm) => {
      const rest = new Float32Array(arm.about.description.actions);
      return { begin() {}, act: () => rest };
    },
  };

  function apply(simulators) {
    for (const [simulator, tolerance] of simulators) {
      for (const [name, value] of Object.entries(numbers)) simulator.set(name, value);
      if (tolerance) simulator.set("tip_tolerance", tolerance);
      simulator.prepare();
    }
  }

  function all() {
    const models = now.movers.filter((mover) => mover.model).map((mover) => [mover.model]);
    return [[now.main], [now.timed], [now.reference, REFERENCE], ...models];
  }

  function made(name, kinds, policy) {
    const arm = arms[name], { description } = arm.about, lanes = kinds.length;
    const [main, reference, timed] = [0, 1, 2].map(() => new Simulator(description, arm.module, lanes));
    return { name, arm, main, reference, timed, kinds, movers: kinds.map((kind) => movers[kind](arm, policy)) };
  }

  function aimed() {
    now.main.observe();
    now.movers.forEach((mover, lane) => mover.begin(now.main, lane));
    now.steps = 0;
    now.held = now.kinds.map(() => null);
  }

  /* Time the step that begins in the states of the reference: clocks of browsers are too coarse for one. */
  function timed() {
    const { reference, timed: copy } = now;
    for (let lane = 0; lane < now.kinds.length; lane++) copy.actions(lane).set(reference.actions(lane));
    const start = performance.now();
    for (let k = 0; k < TIMED_STEPS; k++) {
      copy.follow(reference);
      copy.step();
    }
    timedAt = performance.now();
    microseconds = (1000 * (timedAt - start)) / TIMED_STEPS;
  }

  /* One control step of all movers, and of the reference from the same states. */
  function step(push) {
    const { main, reference } = now, lanes = now.kinds.map((_, lane) => lane);
    for (const [name, value] of push) for (const one of [main, reference, now.timed]) one.set(name, value);
    for (const lane of lanes) {
      main.actions(lane).set(now.movers[lane].act(main, lane));
      reference.actions(lane).set(main.actions(lane));
    }
    for (const sum of ["evaluations_sum", "error_most"]) main.set(sum, 0);
    reference.follow(main);
    const start = performance.now();
    main.step();
    const passed = performance.now() - start;
    now.steps += 1;
    now.faults = lanes.map((lane) => main.output("numerics", lane));
    if (lanes.some((lane) => main.output("terminated", lane))) return true;
    if (passed > QUICK) microseconds = 1000 * passed;
    else if (performance.now() - timedAt > TIME_EVERY) timed();
    reference.step();
    now.costs = lanes.map((lane) => ({
      evaluations: main.output("evaluations_sum", lane), estimate: main.output("error_most", lane),
      error: Math.hypot(...["tip_x", "tip_y"].map((x) => main.output(x, lane) - reference.output(x, lane))),
    }));
    for (const lane of lanes) {
      if (main.output("is_success", lane) && now.held[lane] === null) now.held[lane] = now.steps;
    }
    return false;
  }

  function told() {
    const { main, arm } = now, { description } = arm.about, at = description.arm;
    const points = now.kinds.map((_, lane) => {
      const values = main.arm(lane), places = [[0, 0]];
      for (let k = 1; at.includes(`x${k}`); k++) places.push([values[at.indexOf(`x${k}`)], values[at.indexOf(`y${k}`)]]);
      return places;
    });
    const upper = description.motors.travel.filter(Boolean).map(([, name]) => main.get(name));
    const lengths = Object.keys(description.rows.parameter).filter((name) => /^l\d+$/.test(name));
    const reach = [...lengths.map((name) => main.get(name)), ...upper].reduce((a, b) => a + b);
    return {
      arm: now.name, kinds: now.kinds, points, goal: goalOf(main), reach, held: now.held, steps: now.steps,
      range: ["inner", "outer"].map((name) => main.get(name) * reach), dt: description.control_dt,
      tolerance: main.get("goal_tolerance") * reach, costs: now.costs, microseconds,
    };
  }

  const handlers = {
    load({ name, about, code }) {
      arms[name] = { about, module: new WebAssembly.Module(code) };
    },
    begin({ name, kinds, policy, key, goal, values }) {
      if (!now || now.name !== name || String([now.kinds, now.policy]) !== String([kinds, policy])) {
        now = made(name, kinds, policy);
        now.policy = policy;
      }
      numbers = values;
      apply(all());
      now.main.reset(key);
      if (goal) ["goal_x", "goal_y"].forEach((axis, k) => now.main.set(axis, goal[k]));
      now.costs = null;
      now.faults = [];
      aimed();
      return told();
    },
    set({ values }) {
      numbers = values;
      apply(all());
      aimed();
    },
    aim({ goal }) {
      ["goal_x", "goal_y"].forEach((axis, k) => now.main.set(axis, goal[k]));
      aimed();
      return told();
    },
    advance({ steps, push }) {
      let ended = false;
      for (let k = 0; k < steps && !ended; k++) ended = step(push);
      return { ...told(), faults: now.faults, ended };
    },
    /* Hold as many goals as possible, one after the other. */
    trial({ name, kind, policy, goals, values }) {
      const arm = arms[name], mover = movers[kind](arm, policy);
      const simulator = new Simulator(arm.about.description, arm.module);
      numbers = values;
      apply([[simulator], ...(mover.model ? [[mover.model]] : [])]);
      let held = 0;
      for (let k = 0; k < goals; k++) {
        simulator.reset(crypto.getRandomValues(new Uint32Array(4)));
        mover.begin(simulator, 0);
        for (let i = 0; i < TRIAL_STEPS && !simulator.output("terminated"); i++) {
          simulator.actions().set(mover.act(simulator, 0));
          simulator.step();
        }
        held += simulator.output("is_success");
      }
      return { kind, held, goals };
    },
    /* A digest of the states of an episode: FNV-1a on words of 64 bits. */
    check({ name }) {
      const { about, module } = arms[name], simulator = new Simulator(about.description, module);
      const { key, steps, digest } = about.check;
      let number = 1, found = 0xcbf29ce484222325n;
      simulator.reset(key);
      for (let k = 0; k < steps; k++) {
        const actions = simulator.actions();
        for (let j = 0; j < actions.length; j++) {
          number = (Math.imul(number, 1664525) + 1013904223) >>> 0;
          actions[j] = number / 2 ** 31 - 1;
        }
        simulator.step();
        const words = new BigUint64Array(simulator.states().buffer);
        for (const word of words) found = BigInt.asUintN(64, (found ^ word) * 0x100000001b3n);
      }
      return { name, steps, here: found.toString(16).padStart(16, "0"), there: digest };
    },
  };
  onmessage = ({ data }) => {
    try {
      postMessage({ did: data.do, ...handlers[data.do](data) });
    } catch (error) {
      postMessage({ did: "failed", what: data.do, message: String(error) });
    }
  };
}

/* ---- the data ---------------------------------------------------------------------------------------------------- */

const LETTERS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%&()*+-;<=>?@^_`{|}~";

/* Bytes of a text in base 85, as Python's base64.b85encode writes it. */
function bytesOf(text) {
  const missing = (5 - (text.length % 5)) % 5, padded = text + "~".repeat(missing), count = padded.length / 5;
  const values = new Uint8Array(128);
  [...LETTERS].forEach((letter, k) => { values[letter.charCodeAt(0)] = k; });
  const bytes = new DataView(new ArrayBuffer(4 * count));
  for (let k = 0; k < count; k++) {
    let number = 0;
    for (let j = 0; j < 5; j++) number = 85 * number + values[padded.charCodeAt(5 * k + j)];
    bytes.setUint32(4 * k, number);
  }
  return new Uint8Array(bytes.buffer, 0, 4 * count - missing);
}

/* Single-precision numbers from the planes of their bytes. */
function numbersOf(planes) {
  const bytes = new Uint8Array(planes), count = bytes.length / 4;
  return new Float32Array(Uint8Array.from(bytes, (_, k) => bytes[count * (k % 4) + (k >> 2)]).buffer);
}

async function unpacked(text) {
  const packed = bytesOf(text);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(stream).arrayBuffer(), length = new DataView(bytes).getUint32(0, true);
  const data = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  const part = ([start, count]) => bytes.slice(4 + length + start, 4 + length + start + count);
  for (const arm of Object.values(data.arms)) {
    arm.code = part(arm.code);
    for (const policy of Object.values(arm.policies)) policy.weights = numbersOf(part(policy.weights));
  }
  return data;
}

/* ---- the page ---------------------------------------------------------------------------------------------------- */

const COLORS = { learner: "#0072b2", torque: "#d55e00", nobody: "#5b6570", goal: "#009e73", push: "#b0307a" };
const NAMES = { learner: "learner", torque: "computed torque", nobody: "nobody", race: "race" };
const SIZE = 720, MOST_STEPS = 5, SLOW = 300, PAUSE_WHEN_HELD = 50, TRIAL_GOALS = 100;
const MOVE = 0.02, KEY_PUSH = 50, PUSH_PER_METRE = 150, ARROW = 330, GRAB = 26, TRAIL = 60;
const DEFAULTS = { arm: "RPRP", who: "race", policy: "SAC", accuracy: 6 };
const byId = (id) => document.getElementById(id);

const app = {
  data: null, worker: null, seen: null, goal: null, waiting: null, running: true, due: 0, last: null, push: [0, 0], drag: null,
  trail: [], settings: {}, off: new Set(), note: "", pictures: 0, work: 0, answers: {},

  send(message) {
    this.worker.postMessage(message);
  },

  /* A message whose answer is waited for. */
  ask(message) {
    return new Promise((resolve) => {
      (this.answers[message.do] ??= []).push(resolve);
      this.send(message);
    });
  },

  get arm() { return this.data.arms[byId("arm").value]; },
  get pushed() { return this.arm.switches.find(({ label }) => label === "push"); },
  get kinds() { return byId("who").value === "race" ? ["learner", "torque"] : [byId("who").value]; },

  trouble(text) { byId("trouble").textContent = text; },

  /* Values of all fields that sliders, switches and the tolerance set. */
  values() {
    const { rows, initial } = this.arm.description, values = { tip_tolerance: 10 ** -byId("accuracy").value };
    this.arm.sliders.forEach(({ fields, factor }, k) => {
      for (const name of fields) {
        values[name] = this.settings[k] * (factor ? Number(initial.parameter[rows.parameter[name]]) : 1);
      }
    });
    for (const { key, fields } of this.arm.switches) {
      if (this.off.has(key)) for (const name of fields) values[name] = 0;
    }
    return values;
  },

  set() {
    this.send({ do: "set", values: this.values() });
    this.remember();
  },

  begin(goal = null) {
    this.trail = [];
    this.push = [0, 0];
    this.waiting = performance.now();
    const key = crypto.getRandomValues(new Uint32Array(4)), [name, policy] = [byId("arm").value, byId("policy").value];
    this.send({ do: "begin", name, kinds: this.kinds, policy, key, goal, values: this.values() });
  },

  aim([x, y]) {
    const [inner, outer] = this.seen.range, distance = Math.hypot(x, y) || 1e-9;
    const scale = Math.min(outer, Math.max(inner, distance)) / distance;
    this.goal = [x * scale, y * scale];
    this.send({ do: "aim", goal: this.goal });
    this.remember(this.goal);
  },

  run(running) {
    this.running = running;
    byId("pause").textContent = running ? "Pause" : "Go on";
  },

  /* ---- the address ---- */

  remember(goal = null) {
    const words = { arm: byId("arm").value, who: byId("who").value, accuracy: byId("accuracy").value };
    if (this.kinds.includes("learner")) words.policy = byId("policy").value;
    if (goal) words.goal = goal.map((x) => x.toFixed(3)).join(",");
    const text = Object.entries(words).map(([name, value]) => `${name}=${value}`).join("&");
    history.replaceState(null, "", `#${text}`);
  },

  /* Take over the address; the goal it asks for, and what it says that cannot be. */
  restore() {
    const given = new URLSearchParams(location.hash.slice(1)), wrong = [];
    const choose = (name, known, otherwise) => {
      const value = given.get(name);
      if (value !== null && !known.includes(value)) wrong.push(`${name}=${value} (known: ${known.join(", ")})`);
      return known.includes(value) ? value : otherwise;
    };
    byId("arm").value = choose("arm", Object.keys(this.data.arms), DEFAULTS.arm);
    const policies = Object.keys(this.arm.policies);
    const whos = policies.length ? ["learner", "torque", "nobody", "race"] : ["torque", "nobody"];
    this.fill("who", whos.map((who) => [who, NAMES[who]]));
    this.fill("policy", policies.map((name) => [name, name]));
    byId("who").value = choose("who", whos, policies.length ? DEFAULTS.who : "torque");
    byId("policy").value = choose("policy", policies, policies.includes(DEFAULTS.policy) ? DEFAULTS.policy : policies[0]);
    const exponents = Array.from({ length: 11 }, (_, k) => String(k + 2));
    byId("accuracy").value = choose("accuracy", exponents, DEFAULTS.accuracy);
    for (const name of given.keys()) {
      if (!["arm", "who", "policy", "accuracy", "goal"].includes(name)) wrong.push(`${name} (no such word)`);
    }
    let goal = given.has("goal") ? given.get("goal").split(",").map(Number) : null;
    const { initial, rows } = this.arm.description, number = (name) => Number(initial.parameter[rows.parameter[name]]);
    if (goal) {
      const travel = this.arm.description.motors.travel.filter(Boolean).map(([, name]) => number(name));
      const lengths = Object.keys(rows.parameter).filter((name) => /^l\d+$/.test(name)).map(number);
      const reach = [...lengths, ...travel].reduce((a, b) => a + b), far = Math.hypot(...goal);
      if (goal.length !== 2 || !(far >= number("inner") * reach && far <= number("outer") * reach)) {
        wrong.push(`goal=${given.get("goal")} (two numbers, ${number("inner") * reach} to ${number("outer") * reach} m from the base)`);
        goal = null;
      }
    }
    byId("next").checked = goal === null; // a goal of the address stays
    this.trouble(wrong.length ? `The address says ${wrong.join("; ")}: the default is used.` : "");
    this.controls();
    return goal;
  },

  fill(id, options) {
    byId(id).replaceChildren(...options.map(([value, label]) => new Option(label, value)));
  },

  /* ---- controls ---- */

  /* Sliders, switches and bill of the arm. */
  controls() {
    const { description, sliders, switches, policies } = this.arm;
    this.settings = {};
    this.off = new Set();
    byId("sliders").replaceChildren();
    byId("bodies").replaceChildren();
    sliders.forEach((slider, k) => {
      const own = Number(description.initial.parameter[description.rows.parameter[slider.fields[0]]]);
      const row = document.createElement("div"), label = document.createElement("label");
      const input = document.createElement("input"), output = document.createElement("output");
      const id = slider.label.replaceAll(" ", "_");
      Object.assign(row, { className: "slider" });
      Object.assign(label, { htmlFor: id, textContent: slider.label });
      Object.assign(input, { type: "range", id, min: slider.low, max: slider.high, step: slider.step });
      input.value = slider.factor ? 1 : own;
      const show = () => {
        this.settings[k] = Number(input.value);
        output.textContent = `${this.settings[k].toFixed(2)} ${slider.unit}`;
        input.setAttribute("aria-valuetext", output.textContent);
      };
      input.addEventListener("input", () => { show(); this.set(); });
      show();
      row.append(label, input, output);
      byId(slider.body ? "bodies" : "sliders").append(row);
    });
    byId("switches").replaceChildren(...switches.map(({ label, key }) => {
      const made = document.createElement("label"), box = document.createElement("input");
      Object.assign(box, { type: "checkbox", checked: true, id: `switch_${key}` });
      box.addEventListener("change", () => {
        box.checked ? this.off.delete(key) : this.off.add(key);
        this.press(this.push);
        this.bill();
        this.set();
      });
      made.append(box, ` ${label}`);
      return made;
    }));
    const learns = Object.keys(policies).length > 0;
    byId("policy_label").hidden = !this.kinds.includes("learner");
    this.note = learns ? "" : "This page was written without policies, so it has no learner.";
    byId("accuracy_shown").textContent = `1e-${byId("accuracy").value} m`;
    this.bill();
  },

  bill() {
    const off = this.arm.switches.filter(({ key }) => this.off.has(key));
    byId("off").textContent = off.length
      ? `Off: ${off.map(({ label }) => label).join(", ")}. Here its numbers are 0; the bill below is of a scene without it.`
      : "";
    const counts = this.arm.bills[off.map(({ key }) => key).join("+")], rows = Object.entries(counts);
    const cells = (tag, texts) => texts.map((text, k) => {
      const cell = document.createElement(k ? tag : "th");
      cell.textContent = text;
      cell.scope = k ? (tag === "th" ? "col" : "") : tag === "th" ? "col" : "row";
      return cell;
    });
    const line = (tag, texts) => {
      const row = document.createElement("tr");
      row.append(...cells(tag, texts));
      return row;
    };
    byId("bill").tHead.replaceChildren(line("th", ["", ...this.data.bill_columns.map((name) => name.replace("_", " "))]));
    const sums = this.data.bill_columns.map((_, k) => rows.reduce((sum, [, numbers]) => sum + numbers[k], 0));
    byId("bill").tBodies[0].replaceChildren(
      ...[...rows, ["all", sums]].map(([name, numbers]) => line("td", [name.replaceAll("_", " "), ...numbers])));
  },

  costs() {
    const { kinds, costs, microseconds } = this.seen;
    byId("cost").tBodies[0].replaceChildren(...kinds.map((kind, lane) => {
      const row = document.createElement("tr"), cost = costs && costs[lane];
      const texts = [
        NAMES[kind], cost ? cost.evaluations : "", microseconds === null ? "" : `${microseconds.toFixed(0)} µs`,
        cost ? cost.estimate.toExponential(1) : "", cost ? cost.error.toExponential(1) : "",
      ];
      texts.forEach((text, k) => {
        const cell = document.createElement(k ? "td" : "th");
        cell.textContent = text;
        row.append(cell);
      });
      return row;
    }));
  },

  say() {
    const { kinds, held, goal, steps, dt } = this.seen, seconds = (n) => `${(n * dt).toFixed(2)} s`;
    const movers = kinds.filter((kind) => kind !== "nobody").map((kind) => {
      const when = held[kinds.indexOf(kind)];
      return `${NAMES[kind]} ${when === null ? `does not hold it yet (${seconds(steps)})` : `holds it after ${seconds(when)}`}`;
    });
    const slow = this.waiting !== null && performance.now() - this.waiting > SLOW;
    const parts = [`Goal ${goal.map((x) => x.toFixed(2)).join(", ")} m`, ...movers].join("; ");
    byId("said").textContent = slow ? "A hard step: still computing ..." : `${parts}. ${this.note}`;
  },

  /* ---- picture ---- */

  place([x, y]) {
    const scale = SIZE / 2 / (1.12 * this.seen.reach);
    return [SIZE / 2 + scale * x, SIZE / 2 - scale * y];
  },

  point(event) {
    const box = byId("view").getBoundingClientRect(), scale = SIZE / 2 / (1.12 * this.seen.reach);
    const [u, v] = [event.clientX - box.left, event.clientY - box.top].map((x) => (x * SIZE) / box.width);
    return { pixels: [u, v], metres: [(u - SIZE / 2) / scale, (SIZE / 2 - v) / scale] };
  },

  draw() {
    const { kinds, points, reach, tolerance } = this.seen, { goal } = this, pen = byId("view").getContext("2d");
    const circle = (at, radius, fill) => {
      pen.beginPath();
      pen.arc(...this.place(at), radius, 0, 2 * Math.PI);
      fill ? pen.fill() : pen.stroke();
    };
    const line = (from, to) => {
      pen.beginPath();
      pen.moveTo(...this.place(from));
      pen.lineTo(...this.place(to));
      pen.stroke();
    };
    const pixels = this.place([1, 0])[0] - SIZE / 2;
    Object.assign(pen, { fillStyle: "#ffffff", lineCap: "round", lineWidth: 1.5, strokeStyle: "#d8dce0" });
    pen.fillRect(0, 0, SIZE, SIZE);
    circle([0, 0], reach * pixels);
    Object.assign(pen, { fillStyle: COLORS.goal, strokeStyle: COLORS.goal, lineWidth: 3 });
    circle(goal, Math.max(5, tolerance * pixels), true);
    circle(goal, 15);
    pen.lineWidth = 2;
    this.trail.forEach((tips, k) => tips.forEach((tip, lane) => {
      if (!k || !this.trail[k - 1][lane]) return;
      Object.assign(pen, { strokeStyle: COLORS[kinds[lane]], globalAlpha: (0.4 * k) / TRAIL });
      line(this.trail[k - 1][lane], tip);
    }));
    pen.globalAlpha = 1;
    for (let lane = kinds.length - 1; lane >= 0; lane--) {
      const places = points[lane], slides = this.data.arms[this.seen.arm].description.motors.travel;
      for (let k = 0; k + 1 < places.length; k++) {
        Object.assign(pen, { strokeStyle: COLORS[kinds[lane]], lineWidth: slides[k] ? 7 : 15 - 2 * k });
        line(places[k], places[k + 1]);
        if (lane) { // of two arms the second has a light line inside, for those who see no colours
          Object.assign(pen, { strokeStyle: "#ffffff", lineWidth: 2 });
          line(places[k], places[k + 1]);
        }
      }
      Object.assign(pen, { fillStyle: "#1d2329" });
      places.forEach((place) => circle(place, 4.5, true));
      if (kinds.length > 1) {
        Object.assign(pen, { fillStyle: COLORS[kinds[lane]], font: "600 17px system-ui, sans-serif" });
        const [x, y] = this.place(places.at(-1));
        pen.fillText(NAMES[kinds[lane]], Math.min(x + 14, SIZE - 140), Math.max(20, y - 12 + 26 * lane));
      }
      if (this.push[0] || this.push[1]) {
        const tip = places.at(-1), end = tip.map((x, k) => x + this.push[k] / ARROW); // N per metre of the arrow
        Object.assign(pen, { strokeStyle: COLORS.push, fillStyle: COLORS.push, lineWidth: 4 });
        line(tip, end);
        circle(end, 6, true);
      }
    }
    if (this.push[0] || this.push[1]) {
      pen.font = "600 17px system-ui, sans-serif";
      pen.fillText(`push ${Math.hypot(...this.push).toFixed(0)} N`, 12, SIZE - 14);
    }
  },

  frame(time) {
    const start = performance.now();
    if (this.seen) {
      const { dt } = this.seen, passed = this.last === null ? 0 : time - this.last;
      this.due = this.running ? Math.min(this.due + passed / 1000, MOST_STEPS * dt) : 0;
      if (this.waiting === null && this.due >= dt) {
        const steps = Math.floor(this.due / dt);
        this.due -= steps * dt;
        this.waiting = performance.now();
        const { fields } = this.pushed;
        this.send({ do: "advance", steps, push: fields.map((name, k) => [name, this.push[k]]) });
      }
      this.draw();
      this.say();
      this.pictures += 1;
    }
    this.last = time;
    this.work += performance.now() - start;
    requestAnimationFrame((next) => this.frame(next));
  },

  hear(answer) {
    const start = performance.now();
    this.answers[answer.did]?.shift()?.(answer);
    if (answer.did === "failed") this.trouble(`The simulator failed in ${answer.what}: ${answer.message}`);
    if (answer.points) {
      this.seen = answer;
      if (answer.did === "begin") this.goal = answer.goal;
      if (answer.did !== "aim") this.waiting = null;
      if (answer.did === "advance") {
        this.trail.push(answer.points.map((places) => places.at(-1)));
        if (this.trail.length > TRAIL) this.trail.shift();
        if (this.pictures % 10 === 0 || !answer.steps) this.costs();
        this.judge(answer);
      }
    }
    this.work += performance.now() - start;
  },

  /* After steps: faults, and the next goal. */
  judge({ faults, ended, held, steps, kinds }) {
    const known = Object.entries(this.data.faults);
    const named = known.filter(([bit]) => faults.some((fault) => fault & bit)).map(([, text]) => text);
    if (named.length) this.trouble(`numerics: ${named.join("; ")}.${ended ? " A new episode begins." : ""}`);
    if (ended) this.begin();
    const done = held.every((when) => when !== null && steps > when + PAUSE_WHEN_HELD);
    if (!ended && done && byId("next").checked && !this.drag && !kinds.includes("nobody")) {
      if (!named.length) this.trouble("");
      this.begin();
    }
  },

  /* ---- input ---- */

  pull({ metres }) {
    if (this.drag === "goal") return this.aim(metres);
    const tip = this.seen.points[0].at(-1), most = this.data.most_push;
    const force = metres.map((x, k) => PUSH_PER_METRE * (x - tip[k])), size = Math.hypot(...force);
    this.press(force.map((x) => x * Math.min(1, most / Math.max(size, 1e-9))));
  },

  press(force) {
    this.push = this.off.has(this.pushed.key) ? [0, 0] : force;
  },

  listen() {
    const view = byId("view"), fresh = () => { this.trouble(""); this.begin(); };
    view.addEventListener("pointerdown", (event) => {
      if (!this.seen) return;
      const point = this.point(event), goal = this.place(this.goal);
      view.setPointerCapture(event.pointerId);
      this.drag = Math.hypot(...goal.map((x, k) => x - point.pixels[k])) < GRAB ? "goal" : "push";
      this.pull(point);
    });
    view.addEventListener("pointermove", (event) => { if (this.drag) this.pull(this.point(event)); });
    for (const end of ["pointerup", "pointercancel"]) {
      view.addEventListener(end, () => { this.drag = null; this.push = [0, 0]; });
    }
    const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    view.addEventListener("keydown", (event) => {
      const way = ways[event.key];
      if (event.ctrlKey || event.altKey || event.metaKey || !this.seen) return;
      if (way && event.shiftKey) this.press(way.map((x) => KEY_PUSH * x));
      else if (way) this.aim(this.goal.map((x, k) => x + MOVE * way[k]));
      else if (event.key === " ") this.run(!this.running);
      else if (event.key.toLowerCase() === "n") fresh();
      else return;
      event.preventDefault();
    });
    view.addEventListener("keyup", (event) => { if (ways[event.key] || event.key === "Shift") this.push = [0, 0]; });
    view.addEventListener("blur", () => { this.push = [0, 0]; });
    byId("pause").addEventListener("click", () => this.run(!this.running));
    byId("new").addEventListener("click", fresh);
    byId("accuracy").addEventListener("input", () => {
      byId("accuracy_shown").textContent = `1e-${byId("accuracy").value} m`;
      this.set();
    });
    for (const id of ["arm", "who", "policy"]) {
      byId(id).addEventListener("change", () => {
        this.remember();
        this.restore();
        fresh();
      });
    }
    byId("check").addEventListener("click", async () => {
      byId("checked").textContent = "computing ...";
      const { steps, here, there } = await this.ask({ do: "check", name: byId("arm").value });
      byId("checked").textContent = here === there
        ? `${steps} steps: digest ${here}, as on the processor that wrote this page.`
        : `${steps} steps: digest ${here} here, ${there} on the processor that wrote this page. They differ.`;
    });
    byId("trial").addEventListener("click", async () => {
      const told = [];
      for (const kind of this.kinds.filter((one) => one !== "nobody")) {
        byId("tried").textContent = "computing ...";
        const [name, policy, values] = [byId("arm").value, byId("policy").value, this.values()];
        const { held, goals } = await this.ask({ do: "trial", name, kind, policy, goals: TRIAL_GOALS, values });
        told.push(`${NAMES[kind]} holds ${held} of ${goals}`);
      }
      byId("tried").textContent = told.length ? `${told.join(", ")}.` : "nobody holds a goal.";
    });
    window.addEventListener("hashchange", () => this.begin(this.restore()));
  },

  async start() {
    if (typeof WebAssembly !== "object" || typeof DecompressionStream !== "function") {
      return this.trouble("This browser has no WebAssembly, or cannot unpack data; use a newer one.");
    }
    try {
      this.data = await unpacked(DATA);
    } catch (error) {
      return this.trouble(`The file data.js is damaged or missing; write the page again: python -m redundant_envs page. (${error.message})`);
    }
    const arms = Object.entries(this.data.arms);
    if (!arms.every(([, arm]) => WebAssembly.validate(arm.code))) {
      return this.trouble("This browser has no WebAssembly vectors (SIMD), which the simulator needs; use a newer one.");
    }
    const source = `${[Simulator, Policy, ComputedTorque].map(String).join("\n")}\n(${work})();`;
    this.worker = new Worker(URL.createObjectURL(new Blob([source], { type: "text/javascript" })));
    this.worker.onmessage = ({ data }) => this.hear(data);
    this.worker.onerror = (event) => this.trouble(`The simulator cannot start: ${event.message}`);
    for (const [name, { code, ...about }] of arms) this.send({ do: "load", name, about, code });
    this.fill("arm", arms.map(([name]) => [name, name === "FourR" ? "4R" : name]));
    this.listen();
    this.begin(this.restore());
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) this.run(false);
    requestAnimationFrame((time) => this.frame(time));
  },
};

app.start();
