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

/* Computed torque along a minimum-jerk motion to a pose at the goal, as redundant_envs.control has it. */
class ComputedTorque {
  static DURATION = 1.3; // s
  static FREQUENCY = 12; // rad/s
  static ITERATIONS = 60; // of the search for a pose
  static DAMPING = 1e-4;
  static MARGIN = 0.02; // share of the travel kept free at its ends
  static LARGEST_TURN = 0.3; // rad or m, of one iteration
  static TURN_SPEED = 0.8; // of the joints along the null space, rad/s and m/s

  /* model: a simulator of the same environment, whose state is this controller's to change */
  constructor(model) {
    this._model = model;
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
  _pose(q, goal) {
    const { map, inverse } = this._motors, n = q.length, at = this._at;
    const product = ComputedTorque.product, still = new Array(n).fill(0);
    const ranges = this._ranges();
    let phi = product(q, map), best = phi, least = Infinity;
    for (let k = 0; k < ComputedTorque.ITERATIONS; k++) {
      const arm = this._evaluated(product(phi, inverse), still);
      const error = [goal[0] - arm[at.tip_x], goal[1] - arm[at.tip_y]], size = Math.hypot(...error);
      if (size < least) [least, best] = [size, phi];
      const jacobian = this._jacobian(arm);
      const free = new Array(n).fill(1);
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

  /* Plan a motion from coordinates to a goal [m]. */
  begin(q, goal) {
    this._start = q.slice();
    this._goal = goal;
    this._end = this._pose(q, goal);
    this._time = this._steps = this._wanted = 0;
    this._path = new Map([[0, { pose: this._end, along: q.map((_, j) => (j ? 0 : 1)) }]]); // the first joint leads
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
    const dot = (u, v) => u.reduce((sum, x, j) => sum + x * v[j], 0), movable = phi.map(() => 1);
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

  /* The action in a state, one control step after the previous one. */
  act(q, qd) {
    const T = ComputedTorque.DURATION, w = ComputedTorque.FREQUENCY, s = Math.min(1, this._time / T);
    const turning = this._turning();
    this._time += this._dt;
    const acceleration = q.map((x, i) => {
      const distance = this._end[i] - this._start[i];
      const share = s ** 3 * (10 - 15 * s + 6 * s * s), place = this._start[i] + distance * share;
      const rate = (distance * 30 * s * s * (1 - s) ** 2) / T + turning[i] * share;
      return (distance * 60 * s * (1 - 3 * s + 2 * s * s)) / (T * T) + 2 * w * (rate - qd[i]) + w * w * (place - x);
    });
    const arm = this._evaluated(q, qd), at = this._at, { map, inverse, limits, friction } = this._motors;
    const forces = acceleration.map((_, i) => acceleration.reduce(
      (sum, x, j) => sum + arm[at[`M${i + 1}${j + 1}`]] * x, arm[at[`h${i + 1}`]] + arm[at[`G${i + 1}`]]));
    const rates = ComputedTorque.product(qd, map);
    return inverse.map((row, i) => {
      const needed = row.reduce((sum, x, j) => sum + x * forces[j], 0);
      const opposed = friction ? this._model.get(friction[i]) * rates[i] : 0;
      return Math.min(1, Math.max(-1, (needed + opposed) / this._model.get(limits[i])));
    });
  }
}

if (typeof module !== "undefined") module.exports = { Simulator, Policy, ComputedTorque };
