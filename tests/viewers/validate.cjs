// validate.cjs FILE: the Khronos validator on a result. Errors end the run, the rest is told by code.
const fs = require("fs");
const validator = require("gltf-validator");

validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])), { maxIssues: 0 }).then(({ issues, info }) => {
  const counts = {};
  for (const { code, severity } of issues.messages) {
    const name = `${["error", "warning", "info", "hint"][severity]} ${code}`;
    counts[name] = (counts[name] ?? 0) + 1;
  }
  console.log(`validator: ${issues.numErrors} errors, ${info.totalTriangleCount} triangles`, counts);
  for (const { message, pointer } of issues.messages.filter(({ severity }) => severity === 0)) {
    console.error(`${pointer}: ${message}`);
  }
  process.exit(issues.numErrors > 0 || info.totalTriangleCount === 0 ? 1 : 0);
});
