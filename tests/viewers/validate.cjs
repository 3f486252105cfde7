// validate.cjs FILE...: the Khronos validator on results. Errors are told and end the run with 1; the rest is counted.
// Pictures that were missing beside a source keep their names in the result, and are no error of it.
const fs = require("fs");
const path = require("path");
const validator = require("gltf-validator");

const options = { maxIssues: 0, ignoredIssues: ["IO_ERROR"] };

async function main(files) {
  const counts = {};
  let errors = 0;
  let triangles = 0;
  for (const file of files) {
    const { issues, info } = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), options);
    errors += issues.numErrors;
    triangles += info.totalTriangleCount;
    for (const { code, severity, message, pointer } of issues.messages) {
      const name = `${["error", "warning", "info", "hint"][severity]} ${code}`;
      counts[name] = (counts[name] ?? 0) + 1;
      if (severity === 0) console.error(`${path.basename(file)}: ${pointer}: ${code}: ${message}`);
    }
  }
  console.log(`validator: ${files.length} files, ${triangles} triangles, ${errors} errors`, counts);
  process.exit(errors > 0 || triangles === 0 ? 1 : 0);
}

main(process.argv.slice(2));
