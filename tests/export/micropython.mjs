// Runs a folder's test_controller.py in MicroPython: node micropython.mjs PACKAGE FOLDER
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [, , packageFolder, folder] = process.argv;
const { loadMicroPython } = await import(pathToFileURL(`${packageFolder}/micropython.mjs`));
const machine = await loadMicroPython({ stdout: (line) => console.log(line), linebuffer: true });
for (const name of ["controller.py", "test_controller.py"]) {
  machine.FS.writeFile(`/${name}`, readFileSync(`${folder}/${name}`, "utf-8"));
}
machine.runPython("import sys; sys.path.append('/'); print(sys.implementation.name)");
machine.runPython("import test_controller");
