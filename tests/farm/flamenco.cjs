// The Flamenco job type as the Manager uses it, with the Manager's `author` and `job` played here: there is no Manager in any
// package. Arguments: the program `cairn`, the job type, a scene.
"use strict";
const assert = require("node:assert");
const { execFileSync } = require("node:child_process");
const fs = require("node:fs");
const vm = require("node:vm");

const [program, script, scene] = process.argv.slice(2);
const author = {
    Task: (name, type) => ({
        name, type, commands: [], dependencies: [],
        addCommand(command) { this.commands.push(command); },
        addDependency(task) { this.dependencies.push(task.name); },
    }),
    Command: (name, parameters) => ({ name, parameters }),
};
const context = vm.createContext({ author });
vm.runInContext(fs.readFileSync(script, "utf8") + "\nthis.type = JOB_TYPE; this.compile = compileJob;", context);

// The form.
const TYPES = ["string", "int32", "float", "bool"];
const SUBTYPES = [undefined, "file_path", "dir_path", "file_name", "hashed_file_path"];
const VISIBLE = [undefined, "visible", "hidden", "submission", "web"];
assert.ok(context.type.label);
for (const setting of context.type.settings) {
    assert.match(setting.key, /^[a-z_]+$/);
    assert.ok(TYPES.includes(setting.type) && SUBTYPES.includes(setting.subtype) && VISIBLE.includes(setting.visible), setting.key);
    assert.ok(setting.description, setting.key);
    assert.ok(setting.default !== undefined || setting.required, setting.key);
    assert.ok(!setting.choices || setting.choices.includes(setting.default), setting.key);
}

function tasks(changed) {
    const settings = Object.fromEntries(context.type.settings.map(({ key, default: value }) => [key, value]));
    const job = { settings: { ...settings, scene, output: "/out", program, ...changed }, tasks: [] };
    job.addTask = (task) => job.tasks.push(task);
    context.compile(job);
    return job.tasks;
}
const made = tasks({ seeds: "3-12", chunk_size: 4 });
assert.deepStrictEqual(made.map((task) => task.name), ["seeds-3-6", "seeds-7-10", "seeds-11-12", "rank"]);
assert.deepStrictEqual(made[3].dependencies, made.slice(0, 3).map((task) => task.name));
assert.strictEqual(tasks({ sheet: false }).at(-1).name, "seeds-48-49");
assert.throws(() => tasks({ seeds: "9-3" }), /not a range/);
// What a worker would start, tried.
for (const { type, commands } of made) {
    assert.strictEqual(type, "misc");
    for (const { name, parameters: { exe, args } } of commands) {
        assert.strictEqual(name, "exec");
        if (args[0] === "rank") {
            // There is nothing to rank yet.
            assert.ok(execFileSync(exe, ["rank", "--help"]).length > 0 && args.length === 2);
            continue;
        }
        const told = execFileSync(exe, [...args, "--dry-run"], { encoding: "utf8" });
        assert.match(told, /\d+ {2}\/out\/\d+\.glb {2}missing/);
    }
}
console.log(`flamenco: ${made.length} tasks, whose commands Cairn takes`);
