"use strict";
/* The page: controls, picture, and the messages to a worker, in which all steps run. */

/* ---- the worker: its text, with the classes of kernel.js, becomes a Blob, which works in files, too ------------- */

function work() {
  const TIMED_STEPS = 20, TIMED_FOR = 5, TIME_EVERY = 500, QUICK = 5, REFERENCE = 1e-13, TRIAL_STEPS = 100;
  const arms = {};
  let now = null; // the arm, its simulators and its movers
  let numbers = {}, timedAt = 0, microseconds = null, tried = null;

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
        act: (simulator, lane) => controller.act(...state(simulator, lane)), turn: (way) => controller.turn(way),
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

  /* The movers plan again; the goal stays within reach. */
  function plan() {
    const goal = goalOf(now.main), [inner, outer] = range(), distance = Math.hypot(...goal) || 1e-9;
    const scale = Math.min(outer, Math.max(inner, distance)) / distance;
    if (scale !== 1) ["goal_x", "goal_y"].forEach((axis, k) => now.main.set(axis, goal[k] * scale));
    now.main.observe();
    now.movers.forEach((mover, lane) => mover.begin(now.main, lane));
  }

  /* A goal is new: how long it takes counts from now on. */
  function aimed() {
    plan();
    now.main.set("hold", 0);
    now.steps = 0;
    now.held = now.kinds.map(() => null);
  }

  function reach() {
    const { rows, motors } = now.arm.about.description;
    const upper = motors.travel.filter(Boolean).map(([, name]) => name);
    const lengths = Object.keys(rows.parameter).filter((name) => /^l\d+$/.test(name));
    return [...lengths, ...upper].reduce((sum, name) => sum + now.main.get(name), 0);
  }

  const range = () => ["inner", "outer"].map((name) => now.main.get(name) * reach());

  /* Time the step that begins in the states of the reference: clocks of browsers are too coarse for one. */
  function timed() {
    const { reference, timed: copy } = now;
    for (let lane = 0; lane < now.kinds.length; lane++) copy.actions(lane).set(reference.actions(lane));
    const start = performance.now();
    let count = 0;
    while (count < TIMED_STEPS && (count === 0 || performance.now() - start < TIMED_FOR)) {
      copy.follow(reference);
      copy.step();
      count += 1;
    }
    timedAt = performance.now();
    microseconds = (1000 * (timedAt - start)) / count;
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
    return {
      arm: now.name, kinds: now.kinds, points, goal: goalOf(main), reach: reach(), held: now.held, steps: now.steps,
      holding: now.kinds.map((_, lane) => Boolean(main.output("is_success", lane))),
      range: range(), dt: description.control_dt, tolerance: main.get("goal_tolerance") * reach(),
      costs: now.costs, microseconds, episode: now.episode, order: now.order,
    };
  }

  const handlers = {
    load({ name, about, code }) {
      arms[name] = { about, module: new WebAssembly.Module(code) };
    },
    begin({ name, kinds, policy, key, goal, values, episode, order }) {
      if (!now || now.name !== name || String([now.kinds, now.policy]) !== String([kinds, policy])) {
        now = made(name, kinds, policy);
        now.policy = policy;
      }
      numbers = values;
      apply(all());
      now.main.reset(key, null, goal ? { goal } : {});
      Object.assign(now, { costs: null, faults: [], episode, order });
      microseconds = null;
      aimed();
      return told();
    },
    set({ values, order }) {
      numbers = values;
      apply(all());
      Object.assign(now, { costs: null, order });
      microseconds = null;
      timedAt = 0;
      plan();
      return told();
    },
    aim({ goal, order }) {
      ["goal_x", "goal_y"].forEach((axis, k) => now.main.set(axis, goal[k]));
      now.order = order;
      aimed();
      return told();
    },
    turn({ way }) {
      for (const mover of now.movers) mover.turn?.(way);
      return {};
    },
    advance({ steps, push }) {
      let ended = false;
      for (let k = 0; k < steps && !ended; k++) ended = step(push);
      return { ...told(), faults: now.faults, ended };
    },
    /* Hold as many goals as possible, one after the other: a few for each message, so that others are heard. */
    trial({ name, kind, policy, goals, values, first }) {
      if (first) {
        const arm = arms[name], mover = movers[kind](arm, policy);
        const simulator = new Simulator(arm.about.description, arm.module), kept = numbers;
        numbers = values;
        apply([[simulator], ...(mover.model ? [[mover.model]] : [])]);
        numbers = kept;
        tried = { simulator, mover };
      }
      const { simulator, mover } = tried;
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
      return { held };
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

const NAMES = { learner: "learner", torque: "computed torque", nobody: "nobody", race: "race" };
const SIGNS = {
  additions: "+ −", products: "×", divisions: "÷", roots: "√", sine_pairs: "sin cos", comparisons: "<", selections: "?:",
  bytes: "bytes",
};
const LONGEST_GOAL = 500; // steps after which another goal comes although this one is not held
const MAX_STEPS = 5, SLOW = 300, SLOW_ANSWER = 100, PAUSE_WHEN_HELD = 50, COSTS_EVERY = 200, WRITE_EVERY = 500;
const SMALLEST = 1e-16; // m: smaller differences of the tip are below rounding
const TRIAL_GOALS = 100, TRIAL_SLICE = 5, MAX_FAULTS = 3, FAULTS_WITHIN = 10_000;
const MOVE = 0.02, KEY_PUSH = 50, PUSH_PER_METRE = 150, ARROW = 330, GRAB = 22, TRAIL = 60, MARGIN = 1.12;
const DEFAULTS = { arm: "RPRP", who: "race", policy: "SAC", accuracy: "6" };
const byId = (id) => document.getElementById(id);
const made = (tag, properties, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

const app = {
  data: null, worker: null, seen: null, goal: null, waiting: null, running: true, due: 0, last: null, push: [0, 0],
  drag: null, pressed: new Map(), trail: [], settings: {}, off: new Set(), note: "", episode: 0, order: 0, slow: false,
  answers: {}, faults: [], costsAt: 0, writing: null, told: "", said: "", colors: {}, size: 0, pictures: 0, work: 0,

  send(message) {
    this.worker.postMessage(message);
  },

  /* A message whose answer is waited for; it has "failed" if the worker could not do it. */
  ask(message) {
    return new Promise((resolve) => {
      (this.answers[message.do] ??= []).push(resolve);
      this.send(message);
    });
  },

  get name() { return byId("arm").value; },
  get arm() { return this.data.arms[this.name]; },
  get policies() { return Object.keys(this.arm.policies); },
  get pushed() { return this.arm.switches.find(({ label }) => label === "push"); },
  get kinds() { return byId("who").value === "race" ? ["learner", "torque"] : [byId("who").value]; },

  trouble(text) { if (byId("trouble").textContent !== text) byId("trouble").textContent = text; },

  /* The value of a parameter in the scene. */
  own(name) {
    const { rows, initial } = this.arm.description;
    return Number(initial.parameter[rows.parameter[name]]);
  },

  /* Least and largest distance of goals from the base in the scene, m. */
  get ownRange() {
    const { motors, rows } = this.arm.description, upper = motors.travel.filter(Boolean).map(([, name]) => name);
    const lengths = Object.keys(rows.parameter).filter((name) => /^l\d+$/.test(name));
    const reach = [...lengths, ...upper].reduce((sum, name) => sum + this.own(name), 0);
    return ["inner", "outer"].map((name) => this.own(name) * reach);
  },

  /* Values of all fields that sliders, switches and the tolerance set. */
  values() {
    const values = { tip_tolerance: 10 ** -byId("accuracy").value };
    this.arm.sliders.forEach(({ fields, factor }, k) => {
      for (const name of fields) values[name] = this.settings[k] * (factor ? this.own(name) : 1);
    });
    for (const { key, fields } of this.arm.switches) {
      if (this.off.has(key)) for (const name of fields) values[name] = 0;
    }
    return values;
  },

  set() {
    this.order += 1;
    this.straight();
    this.send({ do: "set", values: this.values(), order: this.order });
    this.clear();
    this.remember();
  },

  begin(goal = null) {
    this.episode += 1;
    this.order += 1;
    this.trail = [];
    this.straight();
    this.waiting = performance.now();
    const key = crypto.getRandomValues(new Uint32Array(4)), { name, kinds, episode, order } = this;
    const policy = byId("policy").value;
    this.send({ do: "begin", name, kinds, policy, key, goal, values: this.values(), episode, order });
  },

  /* A new start, and what was said of the one before is gone. */
  fresh(goal = null) {
    this.trouble("");
    this.faults = [];
    this.begin(goal);
    this.remember();
  },

  aim([x, y]) {
    const [inner, outer] = this.seen.range, distance = Math.hypot(x, y) || 1e-9;
    const scale = Math.min(outer, Math.max(inner, distance)) / distance;
    this.goal = [x * scale, y * scale];
    this.order += 1;
    this.straight();
    this.send({ do: "aim", goal: this.goal, order: this.order });
    this.remember(this.goal);
  },

  /* The movers plan anew: the way along the null space begins at 0. */
  straight() {
    byId("turn").value = 0;
    this.turned();
  },

  turned() {
    byId("turn_shown").textContent = byId("turn").ariaValueText = Number(byId("turn").value).toFixed(2);
  },

  run(running) {
    this.running = running;
    byId("pause").textContent = running ? "Pause" : "Go on";
  },

  /* ---- the address ---- */

  /* Write the address, a little later: browsers do not take many changes at once. */
  remember(goal = null) {
    clearTimeout(this.writing);
    this.writing = setTimeout(() => {
      const words = { arm: this.name, who: byId("who").value, accuracy: byId("accuracy").value };
      if (this.kinds.includes("learner")) words.policy = byId("policy").value;
      const [inner, outer] = this.ownRange;
      if (goal && Math.hypot(...goal) >= inner && Math.hypot(...goal) <= outer) {
        words.goal = goal.map((x) => x.toFixed(3)).join(",");
      }
      const text = Object.entries(words).map(([name, value]) => `${name}=${value}`).join("&");
      try {
        history.replaceState(null, "", `#${text}`);
      } catch { /* the view goes on without its address */ }
    }, WRITE_EVERY);
  },

  /* Take over the address; the goal it asks for. What it says that cannot be is named. */
  restore() {
    const given = new URLSearchParams(location.hash.slice(1)), wrong = [];
    const choose = (name, known, otherwise) => {
      const value = given.get(name);
      if (value !== null && !known.includes(value)) wrong.push(`${name}=${value} (known: ${known.join(", ")})`);
      return known.includes(value) ? value : otherwise;
    };
    clearTimeout(this.writing);
    byId("arm").value = choose("arm", Object.keys(this.data.arms), DEFAULTS.arm);
    this.controls();
    const whos = [...byId("who").options].map((option) => option.value);
    byId("who").value = choose("who", whos, whos.includes(DEFAULTS.who) ? DEFAULTS.who : whos[0]);
    byId("policy").value = choose("policy", this.policies, byId("policy").value);
    const exponents = Array.from({ length: 11 }, (_, k) => String(k + 2));
    byId("accuracy").value = choose("accuracy", exponents, DEFAULTS.accuracy);
    for (const name of given.keys()) {
      if (!["arm", "who", "policy", "accuracy", "goal"].includes(name)) wrong.push(`${name} (no such word)`);
    }
    const [inner, outer] = this.ownRange, text = given.get("goal"), number = "[-+]?(\\d+(\\.\\d*)?|\\.\\d+)";
    let goal = text !== null && new RegExp(`^${number},${number}$`).test(text) ? text.split(",").map(Number) : null;
    if (goal && (Math.hypot(...goal) < inner || Math.hypot(...goal) > outer)) goal = null;
    if (text !== null && !goal) wrong.push(`goal=${text} (two numbers, ${inner} to ${outer} m from the base)`);
    byId("next").checked = goal === null; // a goal of the address stays
    this.labels();
    this.trouble(wrong.length ? `The address says ${wrong.join("; ")}: the default is used.` : "");
    this.faults = [];
    this.begin(goal);
  },

  /* ---- controls ---- */

  fill(id, options) {
    const before = byId(id).value, values = options.map(([value]) => value);
    byId(id).replaceChildren(...options.map(([value, label]) => new Option(label, value)));
    if (values.includes(before)) byId(id).value = before;
  },

  /* Sliders and switches of the arm, as in its scene. */
  controls() {
    const { sliders, switches } = this.arm, learns = this.policies.length > 0;
    const whos = learns ? ["learner", "torque", "nobody", "race"] : ["torque", "nobody"];
    this.fill("who", whos.map((who) => [who, NAMES[who]]));
    this.fill("policy", this.policies.map((name) => [name, name]));
    this.note = learns ? "" : "This page was written without policies, so it has no learner.";
    this.settings = {};
    this.off = new Set();
    byId("sliders").replaceChildren();
    byId("bodies").replaceChildren();
    sliders.forEach((slider, k) => {
      const id = slider.label.replaceAll(" ", "_"), output = made("output", { ariaLive: "off" });
      const input = made("input", { type: "range", id, min: slider.low, max: slider.high, step: slider.step });
      input.value = slider.factor ? 1 : this.own(slider.fields[0]);
      const show = () => {
        this.settings[k] = Number(input.value);
        output.textContent = `${this.settings[k].toFixed(2)} ${slider.unit}`;
        input.ariaValueText = output.textContent;
      };
      input.addEventListener("input", () => { show(); this.set(); });
      show();
      const label = made("label", { htmlFor: id, textContent: slider.label });
      byId(slider.body ? "bodies" : "sliders").append(made("div", { className: "slider" }, label, input, output));
    });
    byId("switches").replaceChildren(...switches.map(({ label, key }) => {
      const box = made("input", { type: "checkbox", checked: true, id: `switch_${key}` });
      box.addEventListener("change", () => {
        box.checked ? this.off.delete(key) : this.off.add(key);
        this.press();
        this.bill();
        this.set();
      });
      return made("label", {}, box, ` ${label}`);
    }));
    this.bill();
    this.clear();
  },

  /* What depends on the choices. */
  labels() {
    byId("policy_label").hidden = !this.kinds.includes("learner");
    byId("turning").hidden = !this.kinds.includes("torque");
    const tolerance = `1e-${byId("accuracy").value} m`;
    byId("accuracy_shown").textContent = byId("accuracy").ariaValueText = tolerance;
  },

  /* Results of tests are of the choices they were made with. */
  clear() {
    byId("tried").textContent = byId("checked").textContent = "";
    this.noCosts();
    this.costsAt = 0;
  },

  bill() {
    const { switches, sliders, bills } = this.arm, off = switches.filter(({ key }) => this.off.has(key));
    const [its, it] = off.length === 1 ? ["Its", "it"] : ["Their", "them"];
    byId("off").textContent = off.length
      ? `Off: ${off.map(({ label }) => label).join(", ")}. ${its} numbers are 0 here; the bill below is of a scene without ${it}.`
      : "";
    const zero = new Set(off.flatMap(({ fields }) => fields));
    sliders.forEach(({ label, fields }) => { byId(label.replaceAll(" ", "_")).disabled = zero.has(fields[0]); });
    const columns = this.data.bill_columns, rows = Object.entries(bills[off.map(({ key }) => key).join("+")]);
    const sums = columns.map((_, k) => rows.reduce((sum, [, counts]) => sum + counts[k], 0));
    const heads = columns.map((name) => made("th", { scope: "col" }, made("abbr", {
      title: name.replace("_", " "), textContent: SIGNS[name] ?? name, ariaLabel: name.replace("_", " "),
    })));
    byId("bill").tHead.replaceChildren(made("tr", {}, made("th", { scope: "col", textContent: "part" }), ...heads));
    byId("bill").tBodies[0].replaceChildren(...[...rows, ["all", sums]].map(([name, counts]) => made("tr", {},
      made("th", { scope: "row", textContent: name.replaceAll("_", " ") }),
      ...counts.map((count) => made("td", { textContent: count })))));
  },

  costs() {
    const { kinds, costs, microseconds } = this.seen;
    const number = (text) => made("span", { className: "number", textContent: text });
    const shown = (error) => (error < SMALLEST ? ["below ", number(SMALLEST)] : [number(error.toExponential(1))]);
    byId("cost").tBodies[0].replaceChildren(...kinds.map((kind, lane) => made("tr", {},
      made("th", { scope: "row", textContent: NAMES[kind] }),
      ...[[costs[lane].evaluations], shown(costs[lane].estimate), shown(costs[lane].error)].map(
        (parts) => made("td", {}, ...parts)))));
    byId("time").textContent = microseconds === null ? ""
      : `A step takes ${microseconds.toFixed(0)} µs here${kinds.length > 1 ? ", for both" : ""}.`;
    this.costsAt = performance.now();
  },

  say() {
    const { kinds, points, held, holding, steps, dt, tolerance } = this.seen, seconds = (n) => `${(n * dt).toFixed(2)} s`;
    const state = (lane) => {
      if (held[lane] === null) return `does not hold it yet (${seconds(steps)})`;
      if (holding[lane]) return `holds it after ${seconds(held[lane])}`;
      const away = Math.hypot(...points[lane].at(-1).map((x, k) => x - this.goal[k])), at = away <= tolerance;
      return `held it after ${seconds(held[lane])}, and is ${at ? "back at it" : `${(100 * away).toFixed(0)} cm away`}`;
    };
    const movers = kinds.map((kind, lane) => [kind, `${NAMES[kind]} ${state(lane)}`]).filter(([kind]) => kind !== "nobody");
    const slow = this.waiting !== null && performance.now() - this.waiting > SLOW;
    const lines = slow ? [["", "A hard step: still computing ..."]]
      : [["", `Goal ${this.goal.map((x) => x.toFixed(2)).join(", ")} m. ${this.note}`], ...movers];
    if (String(lines) !== this.said) {
      this.said = String(lines);
      byId("said").replaceChildren(...lines.map(([kind, text]) => made("div", {},
        ...(kind ? [made("span", { className: `swatch ${this.look(kind)}` })] : []), text)));
    }
    const news = movers.map(([, text]) => text).filter((text) => text.includes("holds it")).join("; ");
    if (news !== this.told) this.told = byId("news").textContent = news; // for screen readers, once
  },

  /* ---- picture ---- */

  get scale() { return this.size / 2 / (MARGIN * this.seen.reach); },

  /* Where a point of the plane [m] is in the picture, in pixels of the page. */
  place([x, y]) {
    return [this.size / 2 + this.scale * x, this.size / 2 - this.scale * y];
  },

  point(event) {
    const box = byId("view").getBoundingClientRect(), [u, v] = [event.clientX - box.left, event.clientY - box.top];
    return { pixels: [u, v], metres: [(u - this.size / 2) / this.scale, (this.size / 2 - v) / this.scale] };
  },

  /* The canvas has as many dots as the screen. */
  fit() {
    const view = byId("view"), fine = window.devicePixelRatio || 1, dots = Math.round(view.clientWidth * fine);
    if (view.width !== dots) view.width = view.height = dots;
    this.size = dots / fine;
    view.getContext("2d").setTransform(fine, 0, 0, fine, 0, 0);
  },

  /* What a mover looks like: a learner as its algorithm in all figures. */
  look(kind) { return kind === "learner" ? byId("policy").value : kind; },

  /* Colours of the style, which has a light and a dark scheme. */
  theme() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["SAC", "PPO", "torque", "nobody", "goal", "push", "paper", "rim", "joint"]) {
      this.colors[name] = style.getPropertyValue(`--${name}`).trim();
    }
  },

  draw() {
    this.fit();
    const { kinds, points, reach, tolerance } = this.seen, { size, scale, goal, colors } = this;
    const pen = byId("view").getContext("2d"), travel = this.data.arms[this.seen.arm].description.motors.travel;
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
    Object.assign(pen, {
      fillStyle: colors.paper, lineCap: "round", lineJoin: "round", lineWidth: 1.5, strokeStyle: colors.rim,
      font: "600 15px system-ui, sans-serif",
    });
    pen.fillRect(0, 0, size, size);
    circle([0, 0], reach * scale);
    Object.assign(pen, { fillStyle: colors.goal, strokeStyle: colors.goal, lineWidth: 3 });
    circle(goal, Math.max(5, tolerance * scale), true);
    circle(goal, 13);
    pen.lineWidth = 2;
    this.trail.forEach((tips, k) => tips.forEach((tip, lane) => {
      if (!k || !this.trail[k - 1][lane]) return;
      Object.assign(pen, { strokeStyle: colors[this.look(kinds[lane])], globalAlpha: (0.4 * k) / TRAIL });
      line(this.trail[k - 1][lane], tip);
    }));
    pen.globalAlpha = 1;
    for (let lane = kinds.length - 1; lane >= 0; lane--) {
      const places = points[lane];
      for (let k = 0; k + 1 < places.length; k++) {
        Object.assign(pen, { strokeStyle: colors[this.look(kinds[lane])], lineWidth: travel[k] ? 6 : 13 - 2 * k });
        line(places[k], places[k + 1]);
        if (kinds[lane] === "torque") { // a light line inside, for those who see no colours
          Object.assign(pen, { strokeStyle: colors.paper, lineWidth: 2 });
          line(places[k], places[k + 1]);
        }
      }
      pen.fillStyle = colors.joint;
      places.forEach((place) => circle(place, 5, true));
      pen.fillStyle = colors.paper;
      places.forEach((place) => circle(place, 2, true));
      if (this.push[0] || this.push[1]) {
        const tip = places.at(-1), end = tip.map((x, k) => x + this.push[k] / ARROW); // N per metre of the arrow
        Object.assign(pen, { strokeStyle: colors.push, fillStyle: colors.push, lineWidth: 4 });
        line(tip, end);
        circle(end, 5, true);
      }
    }
    if (this.push[0] || this.push[1]) {
      pen.fillStyle = colors.push;
      pen.fillText(`push ${Math.hypot(...this.push).toFixed(0)} N`, 12, size - 14); // a corner that no arm reaches
    }
  },

  frame(time) {
    const start = performance.now();
    if (this.seen) {
      const { dt } = this.seen, passed = this.last === null ? 0 : time - this.last;
      this.due = this.running ? Math.min(this.due + passed / 1000, (this.slow ? 1 : MAX_STEPS) * dt) : 0;
      if (this.waiting === null && this.due >= dt) {
        const steps = Math.floor(this.due / dt + 1e-9), { fields } = this.pushed;
        this.due -= steps * dt;
        this.waiting = performance.now();
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
    const of = answer.did === "failed" ? answer.what : answer.did;
    this.answers[of]?.shift()?.({ failed: answer.did === "failed", ...answer });
    if (answer.did === "failed") {
      this.trouble(`The simulator failed in ${answer.what}: ${answer.message}`);
      this.waiting = null;
    }
    if (answer.points && answer.episode === this.episode) { // answers to an older start are late
      this.seen = answer;
      if (answer.order === this.order) this.goal = answer.goal;
      if (answer.did === "begin" || answer.did === "advance") {
        this.slow = this.waiting !== null && start - this.waiting > SLOW_ANSWER;
        this.waiting = null;
      }
      if (answer.did === "advance") {
        this.trail.push(answer.points.map((places) => places.at(-1)));
        if (this.trail.length > TRAIL) this.trail.shift();
        if (answer.costs && start - this.costsAt > COSTS_EVERY) this.costs();
        this.judge(answer);
      } else this.clearCosts();
    }
    this.work += performance.now() - start;
  },

  clearCosts() {
    if (!this.seen.costs) this.noCosts();
    this.costsAt = 0;
  },

  noCosts() {
    byId("cost").tBodies[0].replaceChildren();
    byId("time").textContent = "";
  },

  /* After steps: faults, and the next goal. */
  judge({ faults, ended, held, holding, steps, kinds }) {
    const named = Object.entries(this.data.faults)
      .filter(([bit]) => faults.some((fault) => fault & bit)).map(([, text]) => text);
    if (named.length) this.trouble(`numerics: ${named.join("; ")}.${ended ? " A new episode begins." : ""}`);
    const keep = byId("next").checked ? null : this.goal;
    if (ended) {
      const now = performance.now();
      this.faults = [...this.faults.filter((time) => now - time < FAULTS_WITHIN), now];
      this.begin(keep);
      if (this.faults.length > MAX_FAULTS) {
        this.run(false);
        this.faults = [];
        this.trouble(`numerics: ${named.join("; ")}. Paused after ${MAX_FAULTS + 1} faults in a row.`);
      }
      return;
    }
    const done = holding.every(Boolean) && held.every((when) => when !== null && steps > when + PAUSE_WHEN_HELD);
    if ((done || steps > LONGEST_GOAL) && byId("next").checked && !this.drag && !kinds.includes("nobody")) this.fresh();
  },

  /* ---- input ---- */

  pull({ metres }) {
    if (this.drag === "goal") return this.aim(metres);
    const tip = this.seen.points[0].at(-1);
    return this.press(metres.map((x, k) => PUSH_PER_METRE * (x - tip[k])));
  },

  /* Push the tip, by the force of a drag or of the keys that are held. */
  press(force = null) {
    const wanted = force ?? [0, 1].map((k) => [...this.pressed.values()].reduce((sum, way) => sum + KEY_PUSH * way[k], 0));
    const size = Math.hypot(...wanted), share = Math.min(1, this.data.most_push / Math.max(size, 1e-9));
    this.push = this.off.has(this.pushed.key) ? [0, 0] : wanted.map((x) => x * share);
  },

  release() {
    this.drag = null;
    this.pressed.clear();
    this.press();
  },

  listen() {
    const view = byId("view");
    view.addEventListener("pointerdown", (event) => {
      if (!this.seen || this.drag || event.button !== 0 || !event.isPrimary) return;
      const point = this.point(event), goal = this.place(this.goal);
      view.setPointerCapture(event.pointerId);
      this.drag = Math.hypot(...goal.map((x, k) => x - point.pixels[k])) < GRAB ? "goal" : "push";
      this.pull(point);
    });
    view.addEventListener("pointermove", (event) => {
      if (this.drag && event.isPrimary) this.pull(this.point(event));
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      view.addEventListener(end, (event) => { if (event.isPrimary) this.release(); });
    }
    const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    view.addEventListener("keydown", (event) => {
      const way = ways[event.key];
      if (event.ctrlKey || event.altKey || event.metaKey || !this.seen) return;
      if (way && (event.shiftKey || this.pressed.has(event.key))) {
        this.pressed.set(event.key, way);
        this.press();
      } else if (way) this.aim(this.goal.map((x, k) => x + MOVE * way[k]));
      else if (event.key === " ") { if (!event.repeat) this.run(!this.running); }
      else if (event.key.toLowerCase() === "n") { if (!event.repeat) this.fresh(); }
      else return;
      event.preventDefault();
    });
    view.addEventListener("keyup", (event) => {
      if (this.pressed.delete(event.key)) this.press();
    });
    view.addEventListener("blur", () => this.release());
    byId("pause").addEventListener("click", () => this.run(!this.running));
    byId("new").addEventListener("click", () => this.fresh());
    byId("accuracy").addEventListener("input", () => {
      this.labels();
      this.set();
    });
    byId("turn").addEventListener("input", () => {
      byId("next").checked = false; // the next goal would end it
      this.turned();
      this.send({ do: "turn", way: Number(byId("turn").value) });
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.theme());
    byId("arm").addEventListener("change", () => {
      this.controls();
      this.labels();
      this.fresh();
    });
    for (const id of ["who", "policy"]) {
      byId(id).addEventListener("change", () => {
        this.clear();
        this.labels();
        this.fresh();
      });
    }
    byId("check").addEventListener("click", () => this.check());
    byId("trial").addEventListener("click", () => this.trial());
    window.addEventListener("hashchange", () => this.restore());
  },

  async check() {
    const { name } = this;
    byId("checked").textContent = "computing ...";
    const { failed, steps, here, there } = await this.ask({ do: "check", name });
    if (name !== this.name) return;
    byId("checked").textContent = failed ? "failed." : here === there
      ? `${steps} steps: digest ${here}, as on the processor that wrote this page.`
      : `${steps} steps: digest ${here} here, ${there} on the processor that wrote this page. They differ.`;
  },

  /* How many goals the movers hold, with the numbers of now. */
  async trial() {
    const { name } = this, policy = byId("policy").value, values = this.values(), told = [];
    const kinds = this.kinds.filter((one) => one !== "nobody"), output = byId("tried"), button = byId("trial");
    button.disabled = true;
    output.textContent = kinds.length ? "" : "Nobody holds a goal.";
    search: for (const kind of kinds) {
      let held = 0;
      for (let goals = 0; goals < TRIAL_GOALS; goals += TRIAL_SLICE) {
        const shown = [...told, `${kind === "learner" ? policy : NAMES[kind]}: ${held} of ${goals}`].join("; ");
        output.textContent = `${shown} ...`;
        const message = { do: "trial", name, kind, policy, values, goals: TRIAL_SLICE, first: goals === 0 };
        const answer = await this.ask(message);
        if (answer.failed || output.textContent !== `${shown} ...`) { // something else was chosen meanwhile
          output.textContent = answer.failed ? "failed." : output.textContent;
          told.length = 0;
          break search;
        }
        held += answer.held;
      }
      told.push(`${kind === "learner" ? policy : NAMES[kind]} holds ${held} of ${TRIAL_GOALS}`);
    }
    if (told.length) output.textContent = `${told.join(", ")} goals (${name}).`;
    button.disabled = false;
  },

  async start() {
    if (typeof WebAssembly !== "object" || typeof DecompressionStream !== "function") {
      return this.trouble("This browser has no WebAssembly, or cannot unpack data; use a newer one.");
    }
    if (typeof Simulator !== "function") {
      return this.trouble("The file kernel.js is damaged or missing; write the page again: python -m redundant_envs page.");
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
    try {
      this.worker = new Worker(URL.createObjectURL(new Blob([source], { type: "text/javascript" })));
    } catch (error) {
      return this.trouble(`This browser starts no worker from a file: ${error.message}`);
    }
    this.worker.onmessage = ({ data }) => this.hear(data);
    this.worker.onerror = (event) => this.trouble(`The simulator cannot start: ${event.message}`);
    for (const [name, { code, ...about }] of arms) this.send({ do: "load", name, about, code });
    this.fill("arm", arms.map(([name]) => [name, name === "FourR" ? "4R" : name]));
    this.theme();
    this.listen();
    this.restore();
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) this.run(false);
    requestAnimationFrame((time) => this.frame(time));
  },
};

document.body.classList.toggle("embedded", location.search === "?embedded"); // the picture alone
app.start();
