// In MicroPython: a folder's test_controller.py, then its controller over readings (int16, a row a step).
// node micropython.mjs PACKAGE FOLDER, which has the file `readings`; writes the file `commands`.
import { readFileSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [, , packageFolder, folder] = process.argv;
const { loadMicroPython } = await import(pathToFileURL(`${packageFolder}/micropython.mjs`));
const machine = await loadMicroPython({ stdout: (line) => console.log(line), linebuffer: true });
for (const name of ["controller.py", "test_controller.py", "readings"]) {
  machine.FS.writeFile(`/${name}`, readFileSync(`${folder}/${name}`));
}
machine.runPython("import sys; sys.path.append('/'); print(sys.implementation.name)");
machine.runPython("import test_controller");
machine.runPython(`
from array import array
import controller

one = controller.Controller()
with open("/readings", "rb") as given, open("/commands", "wb") as made:
    row = given.read(2 * controller.SENSORS)
    while row:
        made.write(array("h", one.drive(array("h", row))))
        row = given.read(2 * controller.SENSORS)
`);
writeFileSync(`${folder}/commands`, machine.FS.readFile("/commands"));
