#!/bin/sh
# Renders the LaTeX of all steps and fractals with KaTeX and names what it refuses.
# Needs node and npm; KaTeX is installed into a temporary folder. Usage: scripts/check_latex.sh [BULBFOLD]
set -eu
bulbfold=$(realpath "${1:-target/release/bulbfold}")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent katex >/dev/null
"$bulbfold" list --json > list.json
cat > check.js <<'JS'
const katex = require('katex'), { execFileSync } = require('child_process'), fs = require('fs');
const list = JSON.parse(fs.readFileSync('list.json'));
let count = 0, wrong = 0;
for (const { name } of [...list.steps, ...list.fractals]) {
  const page = execFileSync(process.argv[2], ['explain', name, '--latex'], { encoding: 'utf8' });
  const blocks = page.match(/\\begin\{aligned\}[^]*?\\end\{aligned\}/g) || [];
  for (const block of blocks) {
    count += 1;
    try { katex.renderToString(block, { displayMode: true, throwOnError: true, strict: 'error' }); }
    catch (error) { wrong += 1; console.log(`${name}: ${error.message}\n${block}`); }
  }
}
console.log(`${count} formulas, ${wrong} refused`);
process.exit(wrong || !count ? 1 : 0);
JS
node check.js "$bulbfold"
