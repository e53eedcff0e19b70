"""What the map's benchmarks put into a page: what is drawn and when; and the floor, a bare layer on a bare map."""

from __future__ import annotations

import math

FLAGS = ("--js-flags=--expose-gc", "--enable-precise-memory-info")

# A drone within these latitudes says by its longitude when it was there: how old it is when it is drawn can be seen.
BEACON_LAT_E7 = 606_000_000
BEACON_LON_E7 = 222_000_000
BEACON_ROUND_MS = 1_000_000


def beacon(number, t_ms):
    """Where a beacon is at a time: (lat_e7, lon_e7)."""
    return BEACON_LAT_E7 + number * 100, BEACON_LON_E7 + t_ms % BEACON_ROUND_MS


def _mercator_y(lat_e7):
    radians = math.radians(lat_e7 / 1e7)
    return (1 - math.asinh(math.tan(radians)) / math.pi) / 2


# Times frames, and counts the points of each draw: the drones are the points of one call. Of beacons it notes how old
# they were when the frame after their first drawing began: by then they had been on the screen.
WATCH = """
(() => {
  const seen = (window.__seen = { frames: [], draws: [], ages: [], first: undefined, watching: false });
  let last, next;
  const frame = (now) => {
    if (last !== undefined) seen.frames.push(now - last);
    last = now;
    next = requestAnimationFrame(frame);
  };
  seen.watch = (on) => {
    seen.watching = on;
    cancelAnimationFrame(next);
    if (!on) return;
    seen.frames.length = seen.draws.length = seen.ages.length = 0;
    last = undefined;
    next = requestAnimationFrame(frame);
  };
  const gl = WebGL2RenderingContext.prototype;
  const { bufferData, drawArrays } = gl;
  const shown = new Map();
  let fresh = [];
  gl.bufferData = function (target, data, ...more) {
    bufferData.call(this, target, data, ...more);
    if (!(data instanceof Float32Array) || data.length % FLOATS !== 0) return;
    // A place is x and y, then what a float does not hold of them.
    for (let i = 0; i < data.length; i += FLOATS) {
      const y = data[i + 1];
      if (y < NORTH || y > SOUTH) continue;
      const lat = Math.round((SOUTH - y) * 1e8);
      const lon_e7 = Math.round(((data[i] + data[i + 2]) * 360 - 180) * 1e7);
      if (shown.get(lat) === lon_e7) continue;
      shown.set(lat, lon_e7);
      fresh.push(lon_e7 - BASE);
    }
  };
  gl.drawArrays = function (mode, first, count) {
    drawArrays.call(this, mode, first, count);
    if (mode !== gl.POINTS) return;
    seen.first ??= performance.now();
    seen.draws.push(count);
    if (fresh.length === 0) return;
    const drawn = fresh;
    fresh = [];
    requestAnimationFrame(() => {
      const now = Date.now();
      for (const t of drawn) seen.ages.push((((now - t) % ROUND) + ROUND) % ROUND);
    });
  };
})();
"""
for _name, _value in {
    "FLOATS": 8,
    "NORTH": _mercator_y(BEACON_LAT_E7 + 1_000_000),
    "SOUTH": _mercator_y(BEACON_LAT_E7 - 50),
    "BASE": BEACON_LON_E7,
    "ROUND": BEACON_ROUND_MS,
}.items():
    WATCH = WATCH.replace(_name, repr(_value))

# A custom layer as short as one can be: the positions of as many points uploaded as often, drawn as squares.
FLOOR = """<!doctype html><meta charset="utf-8">
<style>html, body, #map { margin: 0; height: 100% }</style><div id="map"></div>
<script type="module">
import { Map, setWorkerUrl } from "./maplibre-gl.mjs";
setWorkerUrl("./maplibre-gl-worker.mjs");
const { count, hz } = JSON.parse(decodeURIComponent(location.hash.slice(1)));
const style = { version: 8, sources: {}, layers: [{ id: "b", type: "background", paint: { "background-color": "#f3f3ee" } }] };
const map = new Map({ container: "map", style, center: [22.25, 60.45], zoom: 11, attributionControl: false });
const places = new Float32Array(count * 2);
const layer = {
  id: "bare", type: "custom",
  onAdd(_, gl) {
    this.program = gl.createProgram();
    for (const [type, text] of [
      [gl.VERTEX_SHADER, "attribute vec2 a; uniform mat4 m; void main() { gl_Position = m * vec4(a, 0, 1); gl_PointSize = 12.0; }"],
      [gl.FRAGMENT_SHADER, "precision mediump float; void main() { gl_FragColor = vec4(0.0, 0.4, 0.3, 1.0); }"],
    ]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    this.buffer = gl.createBuffer();
  },
  render(gl, { defaultProjectionData }) {
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.program, "m"), false, defaultProjectionData.mainMatrix);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, places, gl.DYNAMIC_DRAW);
    const at = gl.getAttribLocation(this.program, "a");
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, 2, gl.FLOAT, false, 0, 0);
    gl.drawArrays(gl.POINTS, 0, count);
  },
};
map.on("load", () => {
  map.addLayer(layer);
  setInterval(() => {
    if (!window.__seen.watching && window.__seen.draws.length > 9) return;
    const t = performance.now() / 60000;
    for (let i = 0; i < count; i++) {
      const r = Math.sqrt(i / count) * 0.0006;
      places[2 * i] = 0.5618 + r * Math.cos(i * 2.399 + t);
      places[2 * i + 1] = 0.2893 + r * Math.sin(i * 2.399 + t);
    }
    map.triggerRepaint();
  }, 1000 / hz);
});
</script>"""


def crowd_frame(count, sequence, t_ms, centre=(604_500_000, 222_500_000), spread=1.0):
    """The bodies of ``count`` tracks, as pads report them: a field of drones over the town, each of them moving."""
    template = (
        '{"uav_id":"SE-%04d","lat_e7":%d,"lon_e7":%d,"height_mm":60000,"accuracy_mm":3000,"speed_mm_s":12000,'
        '"track_cdeg":9000,"t_ms":%d,"pad_id":"pad-1","transport":"wifi-beacon","verified":false}'
    )
    bodies = []
    for number in range(count):
        swing = (number * 7919 + sequence * 37) % 2000 - 1000
        lat_e7 = centre[0] + int(((number % 100 - min(count, 100) // 2) * 18_000 + swing) * spread)
        lon_e7 = centre[1] + int(((number // 100 - count // 200) * 54_000 + swing) * spread)
        bodies.append((f"SE-{number:04d}", template % (number, lat_e7, lon_e7, t_ms)))
    return bodies
