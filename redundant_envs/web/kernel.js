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

const FORMAT = 1; // of descriptions
const STACK = 1 << 18; // bytes; it is first in memory, so that a stack that is too long is an error
const PAGE = 1 << 16;
const ALIGNMENT = 64;
const ARRAYS = { f64: Float64Array, f32: Float32Array, i64: BigInt64Array, u32: Uint32Array, i8: Int8Array };

class Simulator {
  /* lanes: how many of the block's lanes are simulated, side by side */
  constructor(description, module, lanes = 1) {
    if (description.format !== FORMAT) {
      throw new Error(`the description has format ${description.format}; this kernel.js reads ${FORMAT}`);
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
      names.forEach((name, k) => { values[k] = BigInt(name in places ? places[name] : numbers[name]); });
      this._frames[kernel] = { place, values, names };
    }
    this._operation = this._frames.environment.names.indexOf("operation");
    this._rows = {};
    for (const [space, rows] of Object.entries(description.rows)) {
      for (const [name, row] of Object.entries(rows)) this._rows[name] = [this._arrays[space], row * width];
    }
    this._outputs = {};
    for (const [table, { rows }] of Object.entries(description.tables)) {
      rows.forEach((name, row) => { this._outputs[name] = [this._arrays[table], row * width]; });
    }
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

  _place(kind, places, name, lane) {
    if (!(name in places)) {
      throw new Error(`${kind} is ${name}; this environment has ${Object.keys(places).join(", ")}`);
    }
    const [array, first] = places[name];
    return [array, first + lane];
  }

  /* All numbers as before the first episode, and those that follow from parameters. */
  restart() {
    for (const [space, values] of Object.entries(this.description.initial)) {
      const array = this._arrays[space];
      values.forEach((value, row) => array.fill(Number(value), row * this._width, (row + 1) * this._width));
    }
  }

  /* Begin an episode, in one lane or in all: from a key, four whole numbers of 32 bits. */
  reset(key, lane = null) {
    const length = this.description.episode_key, keys = this._arrays.episode_keys;
    if (key.length !== length - 1) throw new Error(`key has ${key.length} numbers; give ${length - 1}`);
    const lanes = lane === null ? [...Array(this.lanes).keys()] : [lane];
    for (const k of lanes) keys.set([...key, 1], k * length);
    this._run("reset");
    for (const k of lanes) keys[k * length + length - 1] = 0;
  }

  /* Take a control step with actions() in all lanes. */
  step() { this._run("step"); }

  /* Compute observation and outputs again, after set(). */
  observe() { this._run("observe"); }

  /* Compute what follows from parameters, after one of them was set. */
  prepare() { this._call("prepare"); }

  /* The actions of a lane for the next step, to be filled. */
  actions(lane = 0) {
    const n = this.description.actions;
    return this._arrays.actions.subarray(lane * n, (lane + 1) * n);
  }

  observation(lane = 0) {
    const n = this.description.observation.length;
    return this._arrays.obs.subarray(lane * n, (lane + 1) * n);
  }

  /* A state or a parameter by its name in the description. */
  get(name, lane = 0) {
    const [array, place] = this._place("field", this._rows, name, lane);
    return array[place];
  }

  /* Set it in one lane, or in all; after parameters prepare() has to be called. */
  set(name, value, lane = null) {
    const [array, place] = this._place("field", this._rows, name, lane ?? 0);
    if (lane === null) array.fill(value, place, place + this._width);
    else array[place] = value;
  }

  /* The states of a lane, in the order of the rows. */
  states(lane = 0) {
    return this._arrays.state.filter((_, k) => k % this._width === lane);
  }

  /* A result of the last step, reset or observation by its name in the tables of the description. */
  output(name, lane = 0) {
    const [array, place] = this._place("output", this._outputs, name, lane);
    return Number(array[place]);
  }

  /* The arm in the present state: numbers with the names in description.arm. */
  arm(lane = 0) {
    this._call("arm");
    const n = this.description.arm.length;
    return this._arrays.out.subarray(lane * n, (lane + 1) * n);
  }
}

if (typeof module !== "undefined") module.exports = { Simulator };
