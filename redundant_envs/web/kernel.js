"use strict";
/* An environment in WebAssembly: the memory of its lanes, and the calls of its kernels.
 *
 * NAME.wasm and NAME.json, its description, are written by "python -m redundant_envs wasm". In Node:
 *
 *   const { Simulator } = require("./kernel.js"), fs = require("fs");
 *   const description = JSON.parse(fs.readFileSync("rprp_reach.json"));
 *   const simulator = new Simulator(description, new WebAssembly.Module(fs.readFileSync("rprp_reach.wasm")));
 *   simulator.reset([1, 2, 3, 4]);
 *   simulator.actions().set([0.1, 0, -0.2, 0]);
 *   simulator.step();
 *   console.log(simulator.observation(), simulator.output("reward"));
 *
 * The bits are those of the same environment in Python.
 */

class Simulator {
  static FORMAT = 1; // of descriptions
  static STACK = 1 << 18; // bytes; it is first in memory, so that a stack that is too long is an error
  static PAGE = 1 << 16;
  static ALIGNMENT = 64;
  static ARRAYS = { f64: Float64Array, f32: Float32Array, i64: BigInt64Array, u32: Uint32Array, i8: Int8Array };

  /* module: compiled, such as new WebAssembly.Module(bytes); lanes: how many of the block's lanes are simulated,
   * side by side */
  constructor(description, module, lanes = 1) {
    const { FORMAT, STACK, PAGE, ALIGNMENT, ARRAYS } = Simulator;
    if (description.format !== FORMAT) {
      throw new Error(`the description has format ${description.format}; this kernel.js reads ${FORMAT}`);
    }
    const identity = WebAssembly.Module.customSections(module, "identity")[0];
    if (!identity || String.fromCharCode(...new Uint8Array(identity)) !== description.identity) {
      throw new Error("the description is of another module; give the two files of one command");
    }
    if (!(Number.isInteger(lanes) && lanes >= 1 && lanes <= description.lanes)) {
      throw new Error(`lanes is ${lanes}; give 1 to ${description.lanes}`);
    }
    this.description = description;
    this.lanes = lanes;
    this.coordinates = description.coordinates;
    this.rates = description.rates;
    const width = (this._width = description.lanes), sizes = this._sizes(width);
    const places = {};
    let top = STACK;
    for (const [name, [type, count]] of Object.entries(sizes)) {
      places[name] = top;
      top += Math.ceil((count * ARRAYS[type].BYTES_PER_ELEMENT) / ALIGNMENT) * ALIGNMENT;
    }
    for (const kernel of Object.keys(description.kernels)) {
      places[`frame of ${kernel}`] = top;
      top += ALIGNMENT * Math.ceil((8 * Object.keys(description.kernels[kernel]).length) / ALIGNMENT);
    }
    this.bytes = top;
    const memory = new WebAssembly.Memory({ initial: Math.ceil(top / PAGE) });
    const stack = new WebAssembly.Global({ value: "i32", mutable: true }, STACK);
    const env = { __linear_memory: memory, __stack_pointer: stack };
    this._kernels = new WebAssembly.Instance(module, { env }).exports;
    this._arrays = {};
    for (const [name, [type, count]] of Object.entries(sizes)) {
      this._arrays[name] = new ARRAYS[type](memory.buffer, places[name], count);
    }
    const numbers = {
      parameter_stride: description.memories.parameter, count: lanes, substeps: description.substeps,
      stride: width, operation: 0, autoreset: description.autoreset.disabled, any_due: 0,
    };
    this._frames = {};
    for (const [kernel, given] of Object.entries(description.kernels)) {
      const names = Object.keys(given), place = places[`frame of ${kernel}`];
      const values = new BigInt64Array(memory.buffer, place, names.length);
      names.forEach((name, k) => { values[k] = BigInt(Object.hasOwn(places, name) ? places[name] : numbers[name]); });
      this._frames[kernel] = { place, values, names };
    }
    this._operation = this._frames.environment.names.indexOf("operation");
    this._rows = new Map();
    for (const [space, rows] of Object.entries(description.rows)) {
      for (const [name, row] of Object.entries(rows)) this._rows.set(name, [this._arrays[space], row * width]);
    }
    this._outputs = new Map();
    for (const [table, { rows }] of Object.entries(description.tables)) {
      rows.forEach((name, row) => this._outputs.set(name, [this._arrays[table], row * width]));
    }
    this._parameters = new Set(description.parameters);
    this.restart();
  }

  /* Types and lengths of all arrays. */
  _sizes(width) {
    const { memories, kernels, actions, observation, tables, episode_key, arm } = this.description;
    const sizes = {};
    for (const [name, count] of Object.entries(memories)) sizes[name] = [kernels.environment[name], count];
    sizes.actions = ["f32", actions * width];
    sizes.episode_keys = ["u32", episode_key * width];
    sizes.out = ["f64", arm.length * width];
    for (const prefix of ["", "last_"]) {
      sizes[`${prefix}obs`] = ["f32", observation.length * width];
      for (const [table, { type, rows }] of Object.entries(tables)) {
        sizes[prefix + table] = [type, rows.length * width];
      }
    }
    return sizes;
  }

  _call(kernel) {
    this._kernels[kernel](this._frames[kernel].place);
  }

  _run(operation) {
    this._frames.environment.values[this._operation] = BigInt(this.description.operations[operation]);
    this._call("environment");
  }

  _lane(lane) {
    if (!(Number.isInteger(lane) && lane >= 0 && lane < this.lanes)) {
      throw new Error(`lane is ${lane}; give ${this.lanes === 1 ? "0" : `0 to ${this.lanes - 1}`}`);
    }
    return lane;
  }

  _place(kind, places, name, lane) {
    if (!places.has(name)) {
      throw new Error(`${kind} is ${String(name)}; this environment has ${[...places.keys()].join(", ")}`);
    }
    const [array, first] = places.get(name);
    return [array, first + this._lane(lane)];
  }

  _part(array, count, lane) {
    this._lane(lane);
    return array.subarray(lane * count, (lane + 1) * count);
  }

  /* All numbers as before the first episode, and those that follow from parameters. */
  restart() {
    for (const [space, values] of Object.entries(this.description.initial)) {
      const array = this._arrays[space];
      values.forEach((value, row) => array.fill(Number(value), row * this._width, (row + 1) * this._width));
    }
    this._arrays.actions.fill(0);
    this._begun = new Set();
    this._run("observe");
  }

  /* Begin an episode, in one lane or, with equal starts and goals, in all: from a key, four whole numbers of 32
   * bits. As with the options of reset() in Python, q, qd and goal replace what was drawn. */
  reset(key, lane = null, { q, qd, goal } = {}) {
    const length = this.description.episode_key, keys = this._arrays.episode_keys, words = Array.from(key);
    if (words.length !== length - 1 || !words.every((x) => Number.isInteger(x) && x >= 0 && x < 2 ** 32)) {
      throw new Error(`key is ${words.join(", ")}; give ${length - 1} whole numbers from 0 to 2^32 - 1`);
    }
    const lanes = lane === null ? [...Array(this.lanes).keys()] : [this._lane(lane)];
    const given = [[this.coordinates, q, "q"], [this.rates, qd, "qd"], [["goal_x", "goal_y"], goal, "goal"]];
    for (const [names, values, what] of given) {
      if (values && (values.length !== names.length || !Array.from(values).every(Number.isFinite))) {
        throw new Error(`${what} is ${values}; give ${names.length} finite numbers`);
      }
    }
    for (const k of lanes) keys.set([...words, 1], k * length);
    this._run("reset");
    for (const [names, values] of given.filter((one) => one[1])) {
      names.forEach((name, i) => lanes.forEach((k) => this.set(name, values[i], k)));
    }
    if (q || qd || goal) this._run("begin_states"); // and observe
    for (const k of lanes) {
      keys[k * length + length - 1] = 0;
      this._begun.add(k);
    }
  }

  /* Take a control step with actions() in all lanes. */
  step() {
    if (this._begun.size < this.lanes) throw new Error("a lane has no episode yet; call reset() before step()");
    this._run("step");
  }

  /* Compute observation and outputs again, after set(). */
  observe() { this._run("observe"); }

  /* Compute what follows from parameters, after one of them was set. */
  prepare() { this._call("prepare"); }

  /* The actions of a lane for the next step, to be filled. */
  actions(lane = 0) {
    return this._part(this._arrays.actions, this.description.actions, lane);
  }

  observation(lane = 0) {
    return this._part(this._arrays.obs, this.description.observation.length, lane);
  }

  /* A state or a parameter by its name in the description. */
  get(name, lane = 0) {
    const [array, place] = this._place("field", this._rows, name, lane);
    return array[place];
  }

  /* Set a state, or one of description.parameters, in one lane or in all; after parameters prepare() has to be
   * called. Episodes then do not draw this parameter. Whether it is one that Python would accept is not checked. */
  set(name, value, lane = null) {
    const [array, place] = this._place("field", this._rows, name, lane ?? 0);
    if (typeof value !== "number" || Number.isNaN(value)) throw new Error(`${name} is ${value}; give a number`);
    if (array === this._arrays.parameter) {
      if (!this._parameters.has(name)) throw new Error(`${name} follows from others; set one of description.parameters`);
      const fixed = `fixed ${name.replace(/^own_/, "")}`;
      if (this._rows.has(fixed)) this._fill(...this._rows.get(fixed), 1, lane);
    }
    this._fill(array, place - (lane ?? 0), value, lane);
  }

  _fill(array, row, value, lane) {
    if (lane === null) array.fill(value, row, row + this._width);
    else array[row + lane] = value;
  }

  /* A disc by the name of its effect. */
  disc(key, lane = 0) {
    const number = (name) => this.get(`${key}.${name}`, lane);
    return { centre: [number("centre[0]"), number("centre[1]")], radius: number("radius") };
  }

  /* The states of a lane, in the order of the rows. */
  states(lane = 0) {
    this._lane(lane);
    return this._arrays.state.filter((_, k) => k % this._width === lane);
  }

  /* Take over all states of another simulator of the same module. */
  follow(other) {
    this._arrays.state.set(other._arrays.state);
    this._begun = new Set(other._begun);
  }

  /* A result of the last step, reset or observation by its name in the tables of the description. */
  output(name, lane = 0) {
    const [array, place] = this._place("output", this._outputs, name, lane);
    return Number(array[place]);
  }

  /* The arm in the present state: numbers with the names in description.arm. */
  arm(lane = 0) {
    this._call("arm");
    return this._part(this._arrays.out, this.description.arm.length, lane);
  }
}

/* A trained policy: layers of weights and biases, one after the other, in single precision.
 * sizes: numbers of inputs, of each hidden layer, and of actions. */
class Policy {
  static HIDDEN = {
    silu: (x) => x * (0.5 + 0.5 * Math.tanh(0.5 * x)), tanh: Math.tanh, relu: (x) => Math.max(x, 0),
  };
  static OUTPUT = { tanh: Math.tanh, clip: (x) => Math.min(1, Math.max(-1, x)) };

  constructor({ weights, sizes, activation, output }) {
    this._hidden = Policy.HIDDEN[activation];
    this._output = Policy.OUTPUT[output];
    this._layers = [];
    let at = 0;
    for (let k = 0; k + 1 < sizes.length; k++) {
      const matrix = weights.subarray(at, (at += sizes[k] * sizes[k + 1]));
      this._layers.push([matrix, weights.subarray(at, (at += sizes[k + 1]))]);
    }
    if (!this._hidden || !this._output || at !== weights.length) {
      throw new Error(`a policy of ${activation}, ${output} and ${sizes} does not have ${weights.length} numbers`);
    }
  }

  /* The action for an observation. */
  act(observation) {
    return this._layers.reduce((inputs, [matrix, biases], k) => {
      const apply = k + 1 < this._layers.length ? this._hidden : this._output, n = inputs.length;
      return Float64Array.from(biases, (bias, i) => {
        let sum = bias;
        for (let j = 0; j < n; j++) sum += matrix[i * n + j] * inputs[j];
        return apply(sum);
      });
    }, observation);
  }
}

/* Computed torque along a minimum-jerk motion to a pose at the goal, as redundant_envs.control has it. Where the
 * nearest pose or the straight way to it does not serve, others are tried: bent ways to other poses. */
class ComputedTorque {
  static DURATIONS = [1.3, 1.7, 2.2]; // s: the first one that motors can do
  static SOON = 0.85; // s, to a target that moves after 0.9 s
  static FREQUENCY = 12; // rad/s
  static ITERATIONS = 60; // of the search for a pose
  static NEAR = 1e-7; // m from the goal, where the search ends
  static MISS = 2e-3; // m from the goal that a pose may be
  static TRIES = 100; // other ways
  static SAMPLES = 24; // points of a way that are looked at
  static BEND = 0.25; // from a straight way, of the travel or a turn
  static CLEAR = 0.025; // m of a way from discs
  static LOAD = 0.9; // of an effort limit, on a way
  static COSTS = { miss: 1e3, clear: 50, load: 10 }; // in rad
  static DAMPING = 1e-4;
  static MARGIN = 0.02; // share of the travel kept free at its ends
  static LARGEST_TURN = 0.3; // rad or m, of one iteration
  static TURN_SPEED = 0.8; // of the joints along the null space, rad/s and m/s

  /* model: a simulator of the same environment, whose state is this controller's to change; discs: their names */
  constructor(model, discs = []) {
    this._model = model;
    this._discs = discs;
    this._motors = model.description.motors;
    if (!this._motors.limits) throw new Error("computed torque needs actions that are shares of effort limits");
    this._at = Object.fromEntries(model.description.arm.map((name, k) => [name, k]));
    this._dt = model.description.control_dt;
  }

  static product(vector, matrix) {
    return matrix[0].map((_, j) => vector.reduce((sum, x, i) => sum + x * matrix[i][j], 0));
  }

  _evaluated(q, qd) {
    const model = this._model;
    model.coordinates.forEach((name, k) => model.set(name, q[k], 0));
    model.rates.forEach((name, k) => model.set(name, qd[k], 0));
    return model.arm();
  }

  /* Ends of the travel of each joint, with a margin. */
  _ranges() {
    return this._motors.travel.map((names) => {
      if (!names) return [-Infinity, Infinity];
      const [low, high] = names.map((name) => this._model.get(name)), margin = ComputedTorque.MARGIN * (high - low);
      return [low + margin, high - margin];
    });
  }

  /* A pose with the tip at the goal, near a pose: damped Gauss-Newton in the positions of the joints. */
  _pose(q, goal, iterations = ComputedTorque.ITERATIONS) {
    const { map, inverse } = this._motors, n = q.length, at = this._at;
    const product = ComputedTorque.product, still = new Array(n).fill(0);
    const ranges = this._ranges();
    let phi = product(q, map), best = phi, least = Infinity;
    for (let k = 0; k < iterations && least > ComputedTorque.NEAR; k++) {
      const arm = this._evaluated(product(phi, inverse), still);
      const error = [goal[0] - arm[at.tip_x], goal[1] - arm[at.tip_y]], size = Math.hypot(...error);
      if (size < least) [least, best] = [size, phi];
      const jacobian = this._jacobian(arm);
      const free = this._movable.slice();
      let step = still;
      for (let pass = 0; pass < 3; pass++) { // joints at the end of their travel are held
        const [a, b] = jacobian.map((row) => row.map((x, j) => x * free[j]));
        const dot = (u, v) => u.reduce((sum, x, j) => sum + x * v[j], 0);
        const aa = dot(a, a) + ComputedTorque.DAMPING, bb = dot(b, b) + ComputedTorque.DAMPING, ab = dot(a, b);
        const x = (bb * error[0] - ab * error[1]) / (aa * bb - ab * ab);
        const y = (aa * error[1] - ab * error[0]) / (aa * bb - ab * ab);
        step = a.map((value, j) => value * x + b[j] * y);
        step.forEach((change, j) => {
          const [low, high] = ranges[j];
          if (!((phi[j] > low || change > 0) && (phi[j] < high || change < 0))) free[j] = 0;
        });
      }
      const largest = Math.max(1e-12, ...step.map(Math.abs));
      const scale = Math.min(1, ComputedTorque.LARGEST_TURN / largest);
      phi = phi.map((x, j) => Math.min(ranges[j][1], Math.max(ranges[j][0], x + scale * step[j])));
    }
    return product(best, inverse);
  }

  /* Plan a motion from coordinates to a goal [m]; braked: a joint, counted from 0, that does not move; moving:
   * whether act() will be told of other goals. */
  begin(q, goal, braked = -1, moving = false) {
    this._movable = q.map((_, j) => (j === braked ? 0 : 1));
    this._start = q.slice();
    this._goal = goal;
    this._durations = moving ? [ComputedTorque.SOON] : ComputedTorque.DURATIONS;
    const way = this._way(q, goal);
    [this._end, this._bend, this._duration] = [way.end, way.bend, way.duration];
    this._ends = [this._end, this._end];
    this._time = this._steps = this._wanted = 0;
    this._path = new Map([[0, { pose: this._end, along: q.map((_, j) => (j ? 0 : 1)) }]]); // the first joint leads
  }

  /* The way to the nearest pose, or the best of others if that does not serve. */
  _way(q, goal) {
    const between = (a, b) => a.map((x, j) => (x + b[j]) / 2), near = this._pose(q, goal);
    let best = this._judged(near, between(q, near), goal);
    const { product, TRIES, BEND } = ComputedTorque, { map, inverse } = this._motors, ranges = this._ranges();
    const phi = product(q, map);
    let number = 1; // of a linear congruential generator
    const draw = () => (number = (Math.imul(number, 1664525) + 1013904223) >>> 0) / 2 ** 31 - 1;
    const within = (x, j) => (this._movable[j] ? Math.min(ranges[j][1], Math.max(ranges[j][0], x)) : phi[j]);
    const span = ranges.map(([low, high]) => Math.min(2 * Math.PI, high - low));
    for (let k = 0; k < TRIES && best.bad; k++) { // bends of the best way so far, or ways to another pose in turn
      const other = phi.map((x, j) => within(x + span[j] * draw(), j));
      const pose = k % 2 ? best.end : this._pose(product(other, inverse), goal), straight = between(q, pose);
      const bend = product(k % 2 ? best.bend : straight, map).map((x, j) => within(x + BEND * span[j] * draw(), j));
      for (const one of [straight, product(bend, inverse)]) {
        const judged = this._judged(pose, one, goal);
        if (judged.cost < best.cost) best = judged;
      }
    }
    return best;
  }

  /* A way with its duration and its cost; whether it is bad: misses the goal, meets a disc or is too heavy. */
  _judged(end, bend, goal) {
    const { product, SAMPLES, MISS, CLEAR, LOAD, COSTS } = ComputedTorque, { map } = this._motors;
    const still = end.map(() => 0), arm = this._evaluated(end, still), at = this._at;
    let bad = COSTS.miss * Math.max(0, Math.hypot(goal[0] - arm[at.tip_x], goal[1] - arm[at.tip_y]) - MISS);
    const places = Array.from({ length: SAMPLES + 1 }, (_, k) => k / SAMPLES);
    for (const s of this._discs.length ? places : []) {
      const [place] = this._reference(s, 1, end, bend, still, still), values = this._evaluated(place, still);
      bad += COSTS.clear * Math.max(0, CLEAR - this._gap(values));
    }
    let duration = 0, load = Infinity;
    for (const seconds of this._durations) {
      if (load > LOAD) {
        duration = seconds;
        load = Math.max(...places.map((s) => Math.max(...this._shares(
          ...this._reference(s, seconds, end, bend, still, still)).map(Math.abs))));
      }
    }
    bad += COSTS.load * Math.max(0, load - LOAD);
    const far = (a, b) => Math.hypot(...product(a.map((x, j) => x - b[j]), map));
    return { end, bend, duration, bad, cost: bad + far(this._start, bend) + far(bend, end) };
  }

  /* Distance of the links from the discs, m. */
  _gap(arm) {
    const points = [[0, 0]], at = this._at;
    for (let k = 1; `x${k}` in at; k++) points.push([arm[at[`x${k}`]], arm[at[`y${k}`]]]);
    return Math.min(...this._discs.map((key) => ComputedTorque.gap(points, this._model.disc(key))));
  }

  /* Distance of a line through points from a disc, m. */
  static gap(points, { centre, radius }) {
    return Math.min(...points.slice(1).map((b, k) => {
      const a = points[k], way = [b[0] - a[0], b[1] - a[1]], to = [centre[0] - a[0], centre[1] - a[1]];
      const share = (way[0] * to[0] + way[1] * to[1]) / Math.max(way[0] ** 2 + way[1] ** 2, 1e-12);
      const t = Math.min(1, Math.max(0, share));
      return Math.hypot(to[0] - t * way[0], to[1] - t * way[1]) - radius;
    }));
  }

  /* Place, rates and accelerations at a share of the time of a way, whose end may move: a curve of second order. */
  _reference(s, duration, end, bend, rates, accelerations) {
    const u = s ** 3 * (10 - 15 * s + 6 * s * s), v = (30 * s * s * (1 - s) ** 2) / duration;
    const w = (60 * s * (1 - 3 * s + 2 * s * s)) / duration ** 2, a = this._start;
    return [
      end.map((e, i) => (1 - u) ** 2 * a[i] + 2 * u * (1 - u) * bend[i] + u * u * e),
      end.map((e, i) => 2 * v * ((1 - u) * (bend[i] - a[i]) + u * (e - bend[i])) + u * u * rates[i]),
      end.map((e, i) => 2 * w * ((1 - u) * (bend[i] - a[i]) + u * (e - bend[i]))
        + 2 * v * v * (a[i] - 2 * bend[i] + e) + u * u * accelerations[i]),
    ];
  }

  /* Turn the arm while its tip stays: the way of the joints along the null space from the planned pose. */
  turn(way) {
    this._wanted = way;
  }

  /* Move the end of the plan along the null space by what a control step allows; its rates. Poses of the way are
     kept by the number of their step: the way back is the same, and the way ends where the arm cannot go on. */
  _turning() {
    const most = ComputedTorque.TURN_SPEED * this._dt, before = this._end;
    const side = Math.sign(Math.round(this._wanted / most) - this._steps), next = this._steps + side;
    if (!this._path.has(next)) this._path.set(next, this._beside(this._path.get(this._steps), side * most));
    const there = this._path.get(next);
    if (there) [this._end, this._steps] = [there.pose, next];
    return this._end.map((value, i) => (value - before[i]) / this._dt);
  }

  /* The next pose along the null space, and its direction of the joints; null where there is none. */
  _beside({ pose, along }, change) {
    const { map, inverse } = this._motors, phi = ComputedTorque.product(pose, map), ranges = this._ranges();
    const rows = this._jacobian(this._evaluated(pose, pose.map(() => 0)));
    const dot = (u, v) => u.reduce((sum, x, j) => sum + x * v[j], 0), movable = this._movable.slice();
    let free = along;
    for (let pass = 0; pass < phi.length; pass++) { // joints at the end of their travel are held
      const [a, b, led] = [...rows, along].map((row) => row.map((x, j) => x * movable[j]));
      const aa = dot(a, a), bb = dot(b, b), ab = dot(a, b), u = dot(a, led), v = dot(b, led);
      const determinant = Math.max(aa * bb - ab * ab, 1e-9);
      const [x, y] = [(bb * u - ab * v) / determinant, (aa * v - ab * u) / determinant];
      free = led.map((value, j) => value - x * a[j] - y * b[j]);
      free.forEach((value, j) => {
        const [low, high] = ranges[j], way = value * change;
        if ((phi[j] <= low && way < 0) || (phi[j] >= high && way > 0)) movable[j] = 0;
      });
    }
    const size = Math.hypot(...free);
    if (size < 1e-3 || free.some((value, j) => value && !movable[j])) return null;
    const there = phi.map((value, j) => (
      Math.min(ranges[j][1], Math.max(ranges[j][0], value + (change * free[j]) / size))));
    const next = this._pose(ComputedTorque.product(there, inverse), this._goal);
    const gone = Math.hypot(...ComputedTorque.product(next, map).map((value, j) => value - phi[j]));
    if (gone < 0.5 * Math.abs(change) || gone > 2 * Math.abs(change)) return null; // it stays, or jumps
    return { pose: next, along: free.map((value) => value / size) };
  }

  /* Rows of the Jacobian of the tip by the positions of the joints. */
  _jacobian(arm) {
    return [1, 2].map((row) => {
      const ofTip = this._motors.inverse.map((_, j) => arm[this._at[`J${row}${j + 1}`]]);
      return this._motors.inverse.map((column) => column.reduce((sum, x, j) => sum + x * ofTip[j], 0));
    });
  }

  /* Move the end of the plan to a pose at the goal of the next step; rates and accelerations. */
  _following(next) {
    const [before, now] = this._ends, after = this._pose(now, next, 5), dt = this._dt;
    this._ends = [now, after];
    this._end = now;
    return [now.map((_, i) => (after[i] - before[i]) / (2 * dt)),
      now.map((x, i) => (after[i] - 2 * x + before[i]) / (dt * dt))];
  }

  /* The action in a state, one control step after the previous one; next: where a moving goal is after it. */
  act(q, qd, next = null) {
    const w = ComputedTorque.FREQUENCY, s = Math.min(1, this._time / this._duration);
    const moves = next ? this._following(next) : [this._turning(), q.map(() => 0)];
    this._time += this._dt;
    const [place, rate, wanted] = this._reference(s, this._duration, this._end, this._bend, ...moves);
    const acceleration = wanted.map((x, i) => x + 2 * w * (rate[i] - qd[i]) + w * w * (place[i] - q[i]));
    return this._shares(q, qd, acceleration).map((x) => Math.min(1, Math.max(-1, x)));
  }

  /* Efforts for accelerations, as shares of their limits. */
  _shares(q, qd, acceleration) {
    const arm = this._evaluated(q, qd), at = this._at, { map, inverse, limits, friction } = this._motors;
    const forces = acceleration.map((_, i) => acceleration.reduce(
      (sum, x, j) => sum + arm[at[`M${i + 1}${j + 1}`]] * x, arm[at[`h${i + 1}`]] + arm[at[`G${i + 1}`]]));
    const rates = ComputedTorque.product(qd, map);
    return inverse.map((row, i) => {
      const needed = row.reduce((sum, x, j) => sum + x * forces[j], 0);
      const opposed = friction ? this._model.get(friction[i]) * rates[i] : 0;
      return (needed + opposed) / this._model.get(limits[i]);
    });
  }
}

if (typeof module !== "undefined") module.exports = { Simulator, Policy, ComputedTorque };
