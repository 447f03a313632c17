// read_laz.js FILE...: writes the points that laz-perf reads of LAZ files, as the bytes of LAS, to
// FILE.points each.
const fs = require('fs');
const { createLazPerf } = require('laz-perf');

async function main() {
  const lazPerf = await createLazPerf();
  for (const path of process.argv.slice(2)) {
    const file = fs.readFileSync(path);
    const bytes = lazPerf._malloc(file.length);
    lazPerf.HEAPU8.set(file, bytes);
    const reader = new lazPerf.LASZip();
    let points;
    try {
      reader.open(bytes, file.length);
      const size = reader.getPointLength();
      const count = reader.getCount();
      const point = lazPerf._malloc(size);
      points = Buffer.alloc(size * count);
      for (let i = 0; i < count; ++i) {
        reader.getPoint(point);
        points.set(lazPerf.HEAPU8.subarray(point, point + size), i * size);
      }
      lazPerf._free(point);
    } catch (error) {
      throw new Error(`laz-perf cannot read ${path}: ${error}`);
    }
    reader.delete();
    lazPerf._free(bytes);
    fs.writeFileSync(`${path}.points`, points);
  }
}

main().catch((error) => {
  console.error(error.message);
  process.exitCode = 1;
});
