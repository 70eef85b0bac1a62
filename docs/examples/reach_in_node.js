"use strict";
/* Play an environment in Node, and time it:
 *
 *   python -m redundant_envs wasm rprp_reach --out runs/wasm
 *   node docs/examples/reach_in_node.js runs/wasm/rprp_reach
 */
const fs = require("fs"), path = require("path"), zlib = require("zlib");
const name = path.resolve(process.argv[2] || "runs/wasm/rprp_reach");
const { Simulator } = require(path.join(path.dirname(name), "kernel.js"));
const description = JSON.parse(fs.readFileSync(`${name}.json`)), code = fs.readFileSync(`${name}.wasm`);
const simulator = new Simulator(description, new WebAssembly.Module(code));
console.log(`${path.basename(name)}: ${code.length} bytes, ${zlib.gzipSync(code, { level: 9 }).length} packed`);

let state = 1;
const random = () => { // the same numbers every time
  state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
  return state / 2 ** 31 - 1;
};
for (const tolerance of [1e-2, 1e-4, 1e-6, 1e-9, 1e-12]) {
  simulator.restart();
  simulator.set("tip_tolerance", tolerance); // error control: metres at the tip in a control step
  simulator.prepare();
  let evaluations = 0, events = 0;
  const play = (episodes) => {
    for (let episode = 0; episode < episodes; episode++) {
      simulator.reset([episode, 0, 0, 0]);
      for (let step = 0; step < 100; step++) {
        simulator.actions().forEach((_, k, actions) => { actions[k] = random(); });
        simulator.step();
      }
      evaluations += simulator.output("evaluations_sum") / (100 * episodes);
      if (description.tables.counts.rows.includes("events_sum")) events += simulator.output("events_sum");
    }
  };
  play(10); // the engine compiles what runs often
  evaluations = events = 0;
  const start = performance.now();
  play(10);
  const milliseconds = (performance.now() - start) / 1000;
  console.log(`to ${tolerance} m: ${milliseconds.toFixed(3)} ms a step, ${evaluations.toFixed(0)} evaluations, `
    + `${events} impacts in 1000 steps`);
}
