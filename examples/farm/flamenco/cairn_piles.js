// SPDX-License-Identifier: Apache-2.0 OR MIT
"use strict";

/* Many piles of a scene on Flamenco: put this file into the folder `scripts` beside the Manager. Its workers need the program
 * `cairn` and the shared storage. A task that runs again bakes only what is missing. */

const JOB_TYPE = {
    label: "Cairn Piles",
    description: "Bake a pile for each seed of a scene file",
    settings: [
        { key: "scene", type: "string", subtype: "file_path", required: true, visible: "submission",
          description: "Scene file, .toml or .json, on the shared storage" },
        { key: "output", type: "string", subtype: "dir_path", required: true, visible: "submission",
          description: "Folder of the piles, on the shared storage" },
        { key: "seeds", type: "string", required: true, default: "0-49",
          description: "Seeds, both ends included" },
        { key: "format", type: "string", required: true, default: "glb", choices: ["glb", "usdc", "usda", "usdz"],
          description: "Format of the results" },
        { key: "jobs", type: "int32", default: 0, propargs: { min: 0, max: 256 }, visible: "submission",
          description: "Bakes that a task runs at the same time; 0 is one per core" },
        { key: "verify", type: "bool", default: false,
          description: "Bake one pile again in the end, and compare every byte" },
        { key: "chunk_size", type: "int32", default: 4, propargs: { min: 1, max: 100 }, visible: "submission",
          description: "Bakes of a task" },
        { key: "accuracy", type: "string", required: true, default: "standard",
          choices: ["draft", "preview", "standard", "fine", "reference"], description: "How much care is taken" },
        { key: "sheet", type: "bool", default: true, description: "Compare all piles at the end, on a contact sheet" },
        { key: "program", type: "string", default: "cairn", visible: "submission",
          description: "The program on the workers" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    const seeds = /^(\d+)-(\d+)$/.exec(settings.seeds);
    if (!seeds || Number(seeds[1]) > Number(seeds[2])) {
        throw new Error(`seeds: "${settings.seeds}" is not a range; write first-last, such as 0-49`);
    }
    const bakes = [];
    const [first, last] = [Number(seeds[1]), Number(seeds[2])];
    for (let begin = first; begin <= last; begin += settings.chunk_size) {
        const end = Math.min(begin + settings.chunk_size - 1, last);
        const task = author.Task(`seeds-${begin}-${end}`, "misc");
        task.addCommand(author.Command("exec", {
            exe: settings.program,
            args: [
                "batch", settings.scene, "--accuracy", settings.accuracy, "--seeds", `${begin}..${end}`,
                "--output", `${settings.output}/{seed}.${settings.format}`, "--jobs", String(settings.jobs),
                "--progress", "plain",
            ],
        }));
        job.addTask(task);
        bakes.push(task);
    }
    if (settings.verify) {
        const verify = author.Task("verify", "misc");
        const result = `${settings.output}/${first}.${settings.format}`;
        verify.addCommand(author.Command("exec", { exe: settings.program, args: ["verify", result] }));
        bakes.forEach((task) => verify.addDependency(task));
        job.addTask(verify);
    }
    if (settings.sheet) {
        const rank = author.Task("rank", "misc");
        rank.addCommand(author.Command("exec", { exe: settings.program, args: ["rank", settings.output] }));
        bakes.forEach((task) => rank.addDependency(task));
        job.addTask(rank);
    }
}
