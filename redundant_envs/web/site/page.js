"use strict";
/* The page: controls, picture, and the messages to a worker, in which all steps run. */

/* ---- the worker: its text, with the classes of kernel.js, becomes a Blob, which works in files, too ------------- */

function work() {
  const TIMED_STEPS = 20, TIMED_FOR = 5, TIME_EVERY = 500, QUICK = 5, REFERENCE = 1e-13;
  const arms = {};
  let now = null; // the arm, its simulators and its movers
  let numbers = {}, timedAt = 0, microseconds = null, tried = null;

  const state = (simulator, lane) => [simulator.coordinates, simulator.rates].map(
    (names) => names.map((name) => simulator.get(name, lane)));
  const goalOf = (simulator, lane = 0) => ["goal_x", "goal_y"].map((axis) => simulator.get(axis, lane));
  const drawn = (arm) => Object.keys(arm.about.description.scene.randomize ?? {}); // parameters, by episodes
  const moving = (arm) => "phase" in arm.about.description.rows.state; // whether the goal follows a path

  /* The point of the path of a moving goal at an angle, as redundant_envs.tasks.parts.curve has it. */
  function pathAt(simulator, lane, angle) {
    const of = (name) => simulator.get(name, lane), s = Math.sin(angle), c = Math.cos(angle);
    const x = of("along") * c, y = of("across") * (of("eight") > 0.5 ? 2 * s * c : s);
    const [sine, cosine] = [of("tilt_s"), of("tilt_c")];
    return [of("centre_x") + x * cosine - y * sine, of("centre_y") + x * sine + y * cosine];
  }

  /* Where a moving goal is after the next step. */
  function ahead(simulator, lane) {
    const of = (name) => simulator.get(name, lane);
    const ramp = Math.min(1, Math.max(0, (of("steps") * of("interval") - of("wait")) / of("rise")));
    return pathAt(simulator, lane, of("phase") + of("spin") * of("interval") * ramp);
  }

  /* The joint that has failed, counted from 0, or -1. */
  function failed({ about: { fault } }, simulator, lane) {
    return fault && simulator.get(`${fault}.active`, lane) ? simulator.get(`${fault}.joint`, lane) : -1;
  }

  /* Take over what an episode drew, for a simulator beside the first one. */
  function share(arm, from, to, lane = null) {
    for (const name of drawn(arm)) to.set(name, from.get(name, lane ?? 0));
    to.prepare();
  }

  /* A mover: begin(simulator, lane) when there is a new goal, act(simulator, lane) in every step. */
  const movers = {
    learner: (arm, policy) => {
      const { weights, ...about } = arm.about.policies[policy];
      const learned = new Policy({ ...about, weights });
      return { begin() {}, act: (simulator, lane) => learned.act(simulator.observation(lane)) };
    },
    torque: (arm) => {
      const model = new Simulator(arm.about.description, arm.module);
      const controller = new ComputedTorque(model, arm.about.discs);
      let braked = -1;
      const begin = (simulator, lane) => {
        share(arm, simulator, model, lane);
        braked = failed(arm, simulator, lane);
        controller.begin(state(simulator, lane)[0], goalOf(simulator, lane), braked, moving(arm));
      };
      const act = (simulator, lane) => {
        if (failed(arm, simulator, lane) !== braked) begin(simulator, lane);
        return controller.act(...state(simulator, lane), moving(arm) ? ahead(simulator, lane) : null);
      };
      return { model, begin, act, turn: (way) => controller.turn(way) };
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

  /* The movers plan again, before the next step: there may be more changes until then. The goal stays within
   * reach. */
  function plan() {
    if (!moving(now.arm)) {
      const goal = goalOf(now.main), [inner, outer] = range(), distance = Math.hypot(...goal) || 1e-9;
      const scale = Math.min(outer, Math.max(inner, distance)) / distance;
      if (scale !== 1) ["goal_x", "goal_y"].forEach((axis, k) => now.main.set(axis, goal[k] * scale));
    }
    now.main.observe();
    now.planned = false;
  }

  function planned() {
    if (!now.planned) now.movers.forEach((mover, lane) => mover.begin(now.main, lane));
    now.planned = true;
  }

  /* A goal is new, or a disc elsewhere: time and touches count from now on. */
  function aimed() {
    now.main.set("hold", 0);
    if (now.arm.about.discs.length) now.main.set("struck", 0);
    plan();
    now.steps = 0;
    now.held = now.kinds.map(() => null);
  }

  function reach() {
    const { rows, motors } = now.arm.about.description;
    const upper = motors.travel.filter(Boolean).map(([, name]) => name);
    const lengths = Object.keys(rows.parameter).filter((name) => /^l\d+$/.test(name));
    return [...lengths, ...upper].reduce((sum, name) => sum + now.main.get(name), 0);
  }

  function range() {
    return moving(now.arm) ? [0, Infinity] : ["inner", "outer"].map((name) => now.main.get(name) * reach());
  }

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
    planned();
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
    const { discs, fault } = arm.about, moves = moving(arm), each = (tell) => now.kinds.map((_, lane) => tell(lane));
    const turn = moves ? Array.from({ length: 97 }, (_, k) => pathAt(main, 0, (2 * Math.PI * k) / 96)) : [];
    return {
      arm: now.name, kinds: now.kinds, points, goal: goalOf(main), reach: reach(), held: now.held, steps: now.steps,
      holding: each((lane) => Boolean(main.output("is_success", lane))), path: turn,
      range: range(), dt: description.control_dt,
      tolerance: main.get(moves ? "track_tolerance" : "goal_tolerance") * reach(),
      discs: discs.map((key) => main.disc(key)).map((disc) => (
        { ...disc, touched: points.some((places) => ComputedTorque.gap(places, disc) < 0) })),
      struck: each((lane) => Boolean(discs.length && main.get("struck", lane))),
      failed: failed(arm, main, 0), failedAt: fault ? main.get(`${fault}.at`) : null,
      worst: each((lane) => (moves ? main.get("worst", lane) : null)), settle: moves ? main.get("settle") : null,
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
      now.main.restart(); // discs that were moved are drawn again
      apply(all());
      now.main.reset(key, null, goal ? { goal } : {});
      for (const other of [now.reference, now.timed]) share(now.arm, now.main, other);
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
    place({ disc, centre, order }) {
      const key = now.arm.about.discs[disc];
      for (const one of [now.main, now.reference, now.timed]) {
        centre.forEach((value, k) => one.set(`${key}.centre[${k}]`, value));
        one.prepare();
      }
      now.order = order;
      aimed();
      return told();
    },
    turn({ way }) {
      planned();
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
        for (let i = 0; i < arms[name].about.steps && !simulator.output("terminated"); i++) {
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

/* Bytes that LZMA has packed, as PACKING of page.py says: how often each choice was taken in its place so far
 * tells how many bits of the text it takes. */
function unpackedBytes(packed, length) {
  const LITERAL = 2, STATES = 12, out = new Uint8Array(length), last = [0, 0, 0, 0];
  let free = 0, range = 0xffffffff, code = 0, at = 1, count = 0, state = 0;
  const take = (size) => (free += size) - size;
  const [match, again, first, second, third, long] = [1, 1, 1, 1, 1, 1].map(() => take(STATES));
  const [lengths, lengthsAgain] = [take(274), take(274)];
  const [slots, near, align, literals] = [take(256), take(128), take(16), take(0x300 << LITERAL)];
  const shares = new Uint16Array(free).fill(1024);
  const more = () => {
    if (range < 2 ** 24) {
      range *= 256;
      code = ((code << 8) | packed[at++]) >>> 0;
    }
  };
  for (let k = 0; k < 4; k++) code = ((code << 8) | packed[at++]) >>> 0;
  const bit = (place) => {
    const share = shares[place], bound = (range >>> 11) * share, taken = code >= bound;
    if (taken) {
      range -= bound;
      code -= bound;
      shares[place] = share - (share >> 5);
    } else {
      range = bound;
      shares[place] = share + ((2048 - share) >> 5);
    }
    more();
    return taken ? 1 : 0;
  };
  const tree = (place, bits) => {
    let node = 1;
    for (let k = 0; k < bits; k++) node = 2 * node + bit(place + node);
    return node - (1 << bits);
  };
  const backwards = (place, bits) => {
    let node = 1, value = 0;
    for (let k = 0; k < bits; k++) {
      const one = bit(place + node);
      node = 2 * node + one;
      value |= one << k;
    }
    return value;
  };
  const sizeAt = (place) => {
    if (!bit(place)) return 2 + tree(place + 2, 3);
    return bit(place + 1) ? 18 + tree(place + 18, 8) : 10 + tree(place + 10, 3);
  };
  const distance = (size) => {
    const slot = tree(slots + 64 * Math.min(size - 2, 3), 6), bits = (slot >> 1) - 1;
    if (slot < 4) return slot;
    const start = (2 | (slot & 1)) * 2 ** bits;
    if (slot < 14) return start + backwards(near + start - slot, bits);
    let value = 0;
    for (let k = 4; k < bits; k++) {
      range >>>= 1;
      const one = code >= range ? 1 : 0;
      if (one) code -= range;
      value = 2 * value + one;
      more();
    }
    return start + 16 * value + backwards(align, 4);
  };
  while (count < length) {
    if (!bit(match + state)) {
      const place = literals + 0x300 * ((count ? out[count - 1] : 0) >> (8 - LITERAL));
      let symbol = 1;
      if (state >= 7) {
        for (let guess = out[count - last[0] - 1], same = true; symbol < 256 && same; guess <<= 1) {
          const expected = (guess >> 7) & 1, one = bit(place + ((1 + expected) << 8) + symbol);
          symbol = 2 * symbol + one;
          same = one === expected;
        }
      }
      while (symbol < 256) symbol = 2 * symbol + bit(place + symbol);
      out[count++] = symbol;
      state = state < 4 ? 0 : state - (state < 10 ? 3 : 6);
      continue;
    }
    let size = 1, which = -1; // of the last distances, or a new one
    if (bit(again + state)) which = !bit(first + state) ? 0 : !bit(second + state) ? 1 : 2 + bit(third + state);
    if (which < 0) {
      size = sizeAt(lengths);
      last.unshift(distance(size));
      last.pop();
      state = state < 7 ? 7 : 10;
    } else if (which > 0 || bit(long + state)) {
      size = sizeAt(lengthsAgain);
      last.unshift(...last.splice(which, 1));
      state = state < 7 ? 8 : 11;
    } else state = state < 7 ? 9 : 11;
    for (; size > 0; size--, count++) out[count] = out[count - last[0] - 1];
  }
  return out;
}

/* Numbers from the planes of their bytes. */
function numbersOf(planes, scale) {
  const bytes = new Uint8Array(planes), count = bytes.length / 2;
  const numbers = new Int16Array(Uint8Array.from(bytes, (_, k) => bytes[count * (k % 2) + (k >> 1)]).buffer);
  return Float32Array.from(numbers, (x) => x * scale);
}

function unpacked(text) {
  const packed = bytesOf(text), head = new DataView(packed.buffer);
  const bytes = unpackedBytes(packed.subarray(8), head.getUint32(0, true));
  let [a, b] = [1, 0]; // Adler-32
  for (const byte of bytes) b = (b + (a = (a + byte) % 65521)) % 65521;
  if (b * 65536 + a !== head.getUint32(4, true)) throw new Error("its sum is another");
  const length = new DataView(bytes.buffer).getUint32(0, true);
  const data = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
  const part = ([start, count]) => bytes.slice(4 + length + start, 4 + length + start + count).buffer;
  for (const pair of Object.values(data.pairs)) {
    pair.code = part(pair.code);
    for (const policy of Object.values(pair.policies)) policy.weights = numbersOf(part(policy.weights), policy.scale);
  }
  return data;
}

/* ---- the page ---------------------------------------------------------------------------------------------------- */

const NAMES = { learner: "learner", torque: "computed torque", nobody: "nobody", race: "race" };
const TASKS = {
  Reach: "reach", ReachAround: "reach around discs", Track: "track a target", ReachFault: "reach, and a motor fails",
};
const SIGNS = {
  additions: "+ −", products: "×", divisions: "÷", roots: "√", sine_pairs: "sin cos", comparisons: "<", selections: "?:",
  bytes: "bytes",
};
const LONGEST_GOAL = 500; // steps after which another goal comes although this one is not held
const MAX_STEPS = 5, SLOW = 300, SLOW_ANSWER = 100, PAUSE_WHEN_HELD = 50, COSTS_EVERY = 200, WRITE_EVERY = 500;
const SMALLEST = 1e-16; // m: smaller differences of the tip are below rounding
const TRIAL_GOALS = 100, TRIAL_SLICE = 5, MAX_FAULTS = 3, FAULTS_WITHIN = 10_000;
const MOVE = 0.02, KEY_PUSH = 50, PUSH_PER_METRE = 150, ARROW = 330, GRAB = 22, TRAIL = 60, MARGIN = 1.12;
const LONGEST_TRACK = 300, BESIDE_BASE = 0.02; // steps of a target; m of a disc from the base
const DEFAULTS = { arm: "RPRP", task: "Reach", who: "race", policy: "SAC", accuracy: "6" };
const byId = (id) => document.getElementById(id);
const made = (tag, properties, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

const app = {
  data: null, worker: null, seen: null, goal: null, waiting: null, running: true, due: 0, last: null, push: [0, 0],
  drag: null, grip: [0, 0], stop: "", pressed: new Map(), trail: [], settings: {}, off: new Set(), episode: 0, order: 0,
  slow: false,
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

  get name() { return byId("arm").value + byId("task").value; },
  get arm() { return this.data.pairs[this.name]; },
  get moves() { return "phase" in this.arm.description.rows.state; }, // whether the goal moves by itself
  get moved() { return byId("moved").value; }, // by arrow keys: the goal or the number of a disc
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
    if (this.moves) return [0, Infinity];
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
    this.stop = "";
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
    if (this.moves) return;
    const [inner, outer] = this.seen.range, distance = Math.hypot(x, y) || 1e-9;
    const scale = Math.min(outer, Math.max(inner, distance)) / distance;
    this.goal = [x * scale, y * scale];
    this.order += 1;
    this.stop = "";
    this.straight();
    this.send({ do: "aim", goal: this.goal, order: this.order });
    this.remember(this.goal);
  },

  /* Put a disc at a place, or where it stops on the way there. */
  put(disc, [x, y]) {
    const { radius, centre } = this.seen.discs[disc], [inner, outer] = [radius + BESIDE_BASE, this.seen.reach];
    const distance = Math.hypot(x, y), from = distance ? [x, y] : centre;
    const scale = Math.min(outer, Math.max(inner, distance)) / Math.hypot(...from);
    let why = "";
    if (distance < inner) why = "it may not cover the base";
    if (distance > outer) why = "its centre stays within reach";
    this.stop = why && `Disc ${this.letter(disc)} stops here: ${why}.`;
    this.seen.discs[disc].centre = from.map((value) => value * (why ? scale : 1));
    byId("next").checked = false; // the next goal would draw other discs
    this.order += 1;
    this.straight();
    this.send({ do: "place", disc, centre: this.seen.discs[disc].centre, order: this.order });
  },

  letter(disc) { return this.arm.discs[disc].split("_").at(-1); },

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
      const words = Object.fromEntries(["arm", "task", "who", "accuracy"].map((id) => [id, byId(id).value]));
      if (this.kinds.includes("learner")) words.policy = byId("policy").value;
      const [inner, outer] = this.ownRange;
      if (goal && !this.moves && Math.hypot(...goal) >= inner && Math.hypot(...goal) <= outer) {
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
    byId("arm").value = choose("arm", this.data.arms, DEFAULTS.arm);
    byId("task").value = choose("task", this.data.tasks, DEFAULTS.task);
    this.controls();
    const whos = [...byId("who").options].map((option) => option.value);
    byId("who").value = choose("who", whos, whos.includes(DEFAULTS.who) ? DEFAULTS.who : whos[0]);
    byId("policy").value = choose("policy", this.policies, byId("policy").value);
    const exponents = Array.from({ length: 11 }, (_, k) => String(k + 2));
    byId("accuracy").value = choose("accuracy", exponents, DEFAULTS.accuracy);
    for (const name of given.keys()) {
      if (!["arm", "task", "who", "policy", "accuracy", "goal"].includes(name)) wrong.push(`${name} (no such word)`);
    }
    const [inner, outer] = this.ownRange, text = given.get("goal"), number = "[-+]?(\\d+(\\.\\d*)?|\\.\\d+)";
    let goal = text !== null && new RegExp(`^${number},${number}$`).test(text) ? text.split(",").map(Number) : null;
    if (goal && (Math.hypot(...goal) < inner || Math.hypot(...goal) > outer)) goal = null;
    if (this.moves) goal = null;
    if (this.moves && text !== null) wrong.push(`goal=${text} (this goal moves by itself)`);
    else if (text !== null && !goal) wrong.push(`goal=${text} (two numbers, ${inner} to ${outer} m from the base)`);
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
    byId("mover_said").hidden = learns;
    this.fill("moved", [["goal", "goal"], ...this.arm.discs.map((_, disc) => [disc, `disc ${this.letter(disc)}`])]);
    byId("moved_label").hidden = !this.arm.discs.length;
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
    const what = this.moves ? "" : this.arm.discs.length ? "arrow keys move the goal, or the disc chosen above"
      : "arrow keys move the goal";
    const push = `${what ? `${what}, with Shift they` : "arrow keys with Shift"} push the tip with 50 N`;
    byId("keys").textContent = `With the picture in focus: ${push}; N: new start and goal; space: pause.`;
    byId("view").setAttribute("aria-label", `The arm and its goal. ${push.replace(/^a/, "A")}.`);
    byId("next_said").textContent = this.moves ? "next path in time" : "next goal when held";
    byId("policy_label").hidden = !this.kinds.includes("learner");
    byId("turning").hidden = this.moves || !this.kinds.includes("torque");
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

  /* What is said of a mover. */
  state(lane) {
    const { points, held, holding, steps, dt, tolerance, struck, settle, worst } = this.seen;
    const seconds = (n) => `${(n * dt).toFixed(2)} s`;
    const far = (x) => (x < 0.1 ? `${(1000 * x).toFixed(1)} mm` : `${(100 * x).toFixed(0)} cm`);
    const away = Math.hypot(...points[lane].at(-1).map((x, k) => x - this.goal[k]));
    if (settle !== null) {
      if (steps * dt <= settle) return `comes to the target: ${far(away)} away`;
      const after = `${far(away)} away, at most ${far(worst[lane])} since ${settle.toFixed(1)} s`;
      return `${worst[lane] <= tolerance ? "follows it" : "has lost it"}: ${after}`;
    }
    if (struck[lane]) return `touched a disc, which is no success; it is ${far(away)} away`;
    if (held[lane] === null) return `does not hold it yet (${seconds(steps)})`;
    if (holding[lane]) return `holds it after ${seconds(held[lane])}`;
    const now = away <= tolerance ? "back at it" : `${(100 * away).toFixed(0)} cm away`;
    return `held it after ${seconds(held[lane])}, and is ${now}`;
  },

  /* What is said of the task. */
  event() {
    const { arm, failed, failedAt, discs } = this.seen;
    if (failedAt !== null) {
      return failed < 0 ? "The brake of a motor will close within 0.5 s."
        : `The motor of ${this.data.pairs[arm].joints[failed]} failed after ${failedAt.toFixed(2)} s, and its brake holds.`;
    }
    const far = ({ centre }) => Math.hypot(...centre.map((x, k) => x - this.goal[k]));
    const over = discs.findIndex((disc) => far(disc) < disc.radius);
    return [this.stop, over < 0 ? "" : `Disc ${this.letter(over)} covers the goal.`].filter(Boolean).join(" ");
  },

  say() {
    const { kinds } = this.seen, goal = this.goal.map((x) => x.toFixed(2)).join(", "), event = this.event();
    const all = kinds.map((kind, lane) => [kind, `${NAMES[kind]} ${this.state(lane)}`]);
    const movers = all.filter(([kind]) => kind !== "nobody");
    const slow = this.waiting !== null && performance.now() - this.waiting > SLOW;
    const lines = slow ? [["", "A hard step: still computing ..."]]
      : [["", `${this.moves ? "Target" : "Goal"} ${goal} m. ${event}`], ...movers];
    if (String(lines) !== this.said) {
      this.said = String(lines);
      byId("said").replaceChildren(...lines.map(([kind, text]) => made("div", {},
        ...(kind ? [made("span", { className: `swatch ${this.look(kind)}` })] : []), text)));
    }
    const told = movers.map(([, text]) => text).filter((text) => /holds it|touched|has lost/.test(text));
    const news = [event, ...told.map((text) => text.replace(/[;:].*/, ""))].filter(Boolean).join(" ");
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
    const names = ["SAC", "PPO", "torque", "nobody", "goal", "push", "paper", "rim", "joint", "disc", "edge", "alert"];
    for (const name of names) {
      this.colors[name] = style.getPropertyValue(`--${name}`).trim();
    }
  },

  draw() {
    this.fit();
    const { kinds, points, reach, tolerance, discs, path, failed } = this.seen, { size, scale, goal, colors } = this;
    const pen = byId("view").getContext("2d"), travel = this.data.pairs[this.seen.arm].description.motors.travel;
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
    Object.assign(pen, { textAlign: "center", textBaseline: "middle" });
    discs.forEach(({ centre, radius, touched }, disc) => {
      Object.assign(pen, { fillStyle: colors.disc, strokeStyle: touched ? colors.alert : colors.edge });
      circle(centre, radius * scale, true);
      pen.lineWidth = touched ? 6 : 2;
      pen.setLineDash(this.moved === String(disc) ? [6, 4] : []);
      circle(centre, radius * scale);
      pen.fillStyle = colors.joint;
      pen.fillText(this.letter(disc), ...this.place(centre));
    });
    pen.setLineDash([]);
    Object.assign(pen, { textAlign: "start", textBaseline: "alphabetic" });
    if (path.length) {
      Object.assign(pen, { strokeStyle: colors.goal, lineWidth: 1.5, globalAlpha: 0.7 });
      path.slice(1).forEach((to, k) => line(path[k], to));
      pen.globalAlpha = 1;
    }
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
      if (failed >= 0) {
        const [x, y] = places[failed], size = 5 / scale; // a ring with a cross: the brake is closed
        Object.assign(pen, { fillStyle: colors.paper, strokeStyle: colors.alert, lineWidth: 3 });
        circle([x, y], 11, true);
        circle([x, y], 11);
        line([x - size, y - size], [x + size, y + size]);
        line([x - size, y + size], [x + size, y - size]);
      }
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
      if (answer.order === this.order) this.goal = answer.goal;
      else if (this.seen?.arm === answer.arm) answer.discs = this.seen.discs; // moved meanwhile
      this.seen = answer;
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
  judge({ faults, ended, held, holding, struck, settle, steps, kinds }) {
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
    const longest = settle === null ? LONGEST_GOAL : LONGEST_TRACK;
    const over = (lane) => (struck[lane] ? steps > this.arm.steps
      : settle === null && holding[lane] && steps > held[lane] + PAUSE_WHEN_HELD);
    const done = steps > longest || kinds.every((_, lane) => over(lane));
    if (done && byId("next").checked && this.drag === null && !kinds.includes("nobody")) this.fresh();
  },

  /* ---- input ---- */

  pull({ metres }) {
    if (this.drag === "goal") return this.aim(metres);
    if (this.drag !== "push") return this.put(this.drag, metres.map((x, k) => x + this.grip[k]));
    const tip = this.seen.points[0].at(-1);
    return this.press(metres.map((x, k) => PUSH_PER_METRE * (x - tip[k])));
  },

  /* Push the tip, by the force of a drag or of the keys that are held. */
  press(force = null) {
    const wanted = force ?? [0, 1].map((k) => [...this.pressed.values()].reduce((sum, way) => sum + KEY_PUSH * way[k], 0));
    const size = Math.hypot(...wanted), share = Math.min(1, this.data.most_push / Math.max(size, 1e-9));
    this.push = this.off.has(this.pushed.key) ? [0, 0] : wanted.map((x) => x * share);
  },

  /* What a drag from a point takes: the goal, the number of a disc, or else it pushes. */
  under({ pixels, metres }) {
    const near = (at) => Math.hypot(...this.place(at).map((x, k) => x - pixels[k]));
    if (!this.moves && near(this.goal) < GRAB) return "goal";
    const disc = this.seen.discs.findIndex(({ centre, radius }) => near(centre) < Math.max(GRAB, radius * this.scale));
    if (disc < 0) return "push";
    this.grip = this.seen.discs[disc].centre.map((x, k) => x - metres[k]);
    return disc;
  },

  release() {
    this.drag = null;
    this.pressed.clear();
    this.press();
  },

  listen() {
    const view = byId("view");
    view.addEventListener("pointerdown", (event) => {
      if (!this.seen || this.drag !== null || event.button !== 0 || !event.isPrimary) return;
      const point = this.point(event);
      view.setPointerCapture(event.pointerId);
      this.drag = this.under(point);
      if (this.drag !== "push" && !this.moves) byId("moved").value = this.drag;
      this.pull(point);
    });
    view.addEventListener("pointermove", (event) => {
      if (this.drag !== null && event.isPrimary) this.pull(this.point(event));
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
      } else if (way && this.moved === "goal") this.aim(this.goal.map((x, k) => x + MOVE * way[k]));
      else if (way) this.put(Number(this.moved), this.seen.discs[this.moved].centre.map((x, k) => x + MOVE * way[k]));
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
    for (const id of ["arm", "task"]) {
      byId(id).addEventListener("change", () => {
        this.controls();
        this.labels();
        this.fresh();
      });
    }
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

  start() {
    if (typeof WebAssembly !== "object") {
      return this.trouble("This browser has no WebAssembly; use a newer one.");
    }
    if (typeof Simulator !== "function") {
      return this.trouble("The file kernel.js is damaged or missing; write the page again: python -m redundant_envs page.");
    }
    try {
      this.data = unpacked(DATA);
    } catch (error) {
      return this.trouble(`The file data.js is damaged or missing; write the page again: python -m redundant_envs page. (${error.message})`);
    }
    const pairs = Object.entries(this.data.pairs);
    if (!pairs.every(([, arm]) => WebAssembly.validate(arm.code))) {
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
    for (const [name, { code, ...about }] of pairs) this.send({ do: "load", name, about, code });
    this.fill("arm", this.data.arms.map((name) => [name, name === "FourR" ? "4R" : name]));
    this.fill("task", this.data.tasks.map((name) => [name, TASKS[name]]));
    this.theme();
    this.listen();
    this.restore();
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) this.run(false);
    requestAnimationFrame((time) => this.frame(time));
  },
};

document.body.classList.toggle("embedded", location.search === "?embedded"); // the picture alone
app.start();
