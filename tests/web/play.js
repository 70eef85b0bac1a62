"use strict";
/* Play an environment: node play.js FOLDER NAME INPUT OUTPUT
 *
 * INPUT is JSON: {lanes, parameters: {name: value}, keys: [episode][lane], actions: [episode][step][lane]}.
 * OUTPUT has for each step and lane the states, the observation and all outputs, as doubles; then, of lane 0,
 * the parameters and what the kernel "arm" tells.
 */
const fs = require("fs"), path = require("path");
const [folder, name, input, output] = process.argv.slice(2);
const { Simulator } = require(path.join(folder, "kernel.js"));
const description = JSON.parse(fs.readFileSync(path.join(folder, `${name}.json`)));
const module_ = new WebAssembly.Module(fs.readFileSync(path.join(folder, `${name}.wasm`)));
const { lanes, parameters, keys, actions } = JSON.parse(fs.readFileSync(input));
const simulator = new Simulator(description, module_, lanes);
for (const [field, value] of Object.entries(parameters)) simulator.set(field, value);
if (Object.keys(parameters).length) simulator.prepare();
const names = Object.values(description.tables).flatMap((table) => table.rows), told = [];
keys.forEach((ofLanes, episode) => {
  ofLanes.forEach((key, lane) => simulator.reset(key, lane));
  for (const step of actions[episode]) {
    step.forEach((action, lane) => simulator.actions(lane).set(action));
    simulator.step();
    for (let lane = 0; lane < lanes; lane++) {
      told.push(...simulator.states(lane), ...simulator.observation(lane));
      told.push(...names.map((one) => simulator.output(one, lane)));
    }
  }
});
told.push(...Object.keys(description.rows.parameter).map((field) => simulator.get(field)), ...simulator.arm());
fs.writeFileSync(output, Float64Array.from(told));
