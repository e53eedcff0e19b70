import type { Map as MapLibre } from "maplibre-gl";
import { LOOKS } from "../shared/drones";
import { HIDDEN, type Fleet } from "../shared/fleet";
import type { LiveStore } from "../shared/live/store";
import { CELL, CLAIMS_FROM, drawAtlas, HEADING, HOVERED, SELECTED } from "./atlas";
import { upOf } from "./heights";
import { palette } from "./icons";
import { CLOSE_ZOOM, SITE_ZOOM } from "./scales";
import { viewOf, type View } from "./view";
import { MAP_COLOURS } from "./style";

/** With more drones than this, those of which only what is heard is known are drawn small. */
export const CROWD = 1_500;
const SMALL = 0.6;
const HALO = 1.6;
const TURN_MS = 1_600;
const TURN_FRAME_MS = 66;
const PROVING = LOOKS.indexOf("proving");
const FLOATS = 8;
/** Closer than this, it is drawn where a drone flies to; faster than this, mm/s, it flies. */
const HEADING_ZOOM = 13.5;
const HEADING_SIZE = 1.7;
const FLYING_MM_S = 700;

/** Below those that need the officer are those that do not. */
const DRAWN: readonly number[] = ["silent", "out-of-range", "unproved", "verified", "proving", "inconclusive", "refuted"].map((look) =>
  LOOKS.findIndex((each) => each === look),
);

/**
 * A place is two floats for each axis, what a float holds and the rest: at a pad's scale one alone is metres off. The
 * difference to the camera's is exact.
 */
const VERTEX = `#version 300 es
uniform vec4 u_centre;
uniform vec2 u_shift;
uniform vec2 u_size;
uniform float u_scale;
uniform float u_cell;
uniform vec2 u_turn;
uniform vec4 u_tilt;
uniform vec2 u_eye;
in vec4 a_place;
in vec4 a_look;
out float v_look;
out vec2 v_spin;
void main() {
  vec2 away = (a_place.xy - u_centre.xy) + (a_place.zw - u_centre.zw);
  away.x -= round(away.x);
  away *= u_scale;
  float up = a_look.z * u_eye.y;
  vec2 turned = vec2(away.x * u_tilt.x + away.y * u_tilt.y, away.y * u_tilt.x - away.x * u_tilt.y);
  float near = u_eye.x / (u_eye.x - turned.y * u_tilt.w - up * u_tilt.z);
  vec2 at = (vec2(turned.x, turned.y * u_tilt.z - up * u_tilt.w) * near + u_shift) / u_size * 2.0 - 1.0;
  gl_Position = near > 0.0 ? vec4(at.x, -at.y, 0.0, 1.0) : vec4(2.0, 2.0, 0.0, 1.0);
  gl_PointSize = u_cell * a_look.y;
  v_look = a_look.x;
  vec2 course = vec2(sin(a_look.w), cos(a_look.w));
  vec2 seen = vec2(course.y * u_tilt.x + course.x * u_tilt.y, course.x * u_tilt.x - course.y * u_tilt.y) * vec2(u_tilt.z, 1.0);
  v_spin = vec2(1.0, 0.0);
  if (abs(a_look.x - ${PROVING}.0) < 0.5) v_spin = u_turn;
  else if (abs(a_look.x - ${HEADING}.0) < 0.5) v_spin = normalize(seen);
}`;

const FRAGMENT = `#version 300 es
precision mediump float;
precision mediump sampler2DArray;
uniform sampler2DArray u_symbols;
in float v_look;
in vec2 v_spin;
out vec4 colour;
void main() {
  vec2 from = gl_PointCoord - 0.5;
  vec2 at = vec2(from.x * v_spin.x + from.y * v_spin.y, from.y * v_spin.x - from.x * v_spin.y) + 0.5;
  colour = texture(u_symbols, vec3(at, v_look));
}`;

type Made = {
  gl: WebGL2RenderingContext;
  program: WebGLProgram;
  buffer: WebGLBuffer;
  array: WebGLVertexArrayObject;
  texture: WebGLTexture;
  uniforms: Record<"centre" | "shift" | "size" | "scale" | "cell" | "turn" | "tilt" | "eye", WebGLUniformLocation | null>;
};

export type Marked = { selected: number | undefined; hovered: number | undefined };

/**
 * All drones in one draw call, straight from the store's columns, on a canvas of their own over the map: when only they
 * move, which is most of the time, the map beneath is not drawn again.
 */
export class DroneLayer {
  private readonly canvas = document.createElement("canvas");
  private made: Made | undefined;
  private frame: number | undefined;
  private readonly onMapDrawn = (): void => this.draw();
  private readonly onLost = (event: Event): void => {
    // So that it may come back.
    event.preventDefault();
    this.made = undefined;
  };
  private readonly onRestored = (): void => {
    this.make();
    this.draw();
  };
  private vertices = new Float32Array(1_024 * FLOATS);
  private count = 0;
  /** The first so many vertices say where drones fly to. */
  private wedges = 0;
  private stale = true;
  private close = false;
  private tilted = false;
  private headings = false;
  private recolour = true;
  private turning = false;
  private timer: ReturnType<typeof setTimeout> | undefined;

  /** Draws from now on, after each frame of the map and after each `refresh`. */
  constructor(
    private readonly map: MapLibre,
    private readonly store: LiveStore,
    private fleet: Fleet,
    private readonly marked: Marked,
    private readonly calm: boolean,
  ) {
    this.canvas.className = "map-drones";
    this.canvas.setAttribute("aria-hidden", "true");
    map.getCanvasContainer().append(this.canvas);
    this.canvas.addEventListener("webglcontextlost", this.onLost);
    this.canvas.addEventListener("webglcontextrestored", this.onRestored);
    this.make();
    map.on("render", this.onMapDrawn);
  }

  /** After positions, looks or marks have changed. */
  refresh(fleet: Fleet): void {
    this.fleet = fleet;
    this.stale = true;
    this.schedule();
  }

  /** After the theme has changed. */
  retheme(): void {
    this.recolour = true;
    this.schedule();
  }

  private schedule(): void {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = undefined;
      this.draw();
    });
  }

  private make(): void {
    const gl = this.canvas.getContext("webgl2", { antialias: false, depth: false, stencil: false });
    if (gl === null) throw new Error("this browser gives no WebGL 2 to draw the drones with");
    const program = link(gl);
    const uniform = (name: string): WebGLUniformLocation | null => gl.getUniformLocation(program, `u_${name}`);
    const array = gl.createVertexArray();
    const buffer = gl.createBuffer();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    const attribute = (name: string, size: number, offset: number): void => {
      const at = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, gl.FLOAT, false, FLOATS * 4, offset * 4);
    };
    attribute("a_place", 4, 0);
    attribute("a_look", 4, 4);
    gl.bindVertexArray(null);
    this.made = {
      gl,
      program,
      buffer,
      array,
      texture: gl.createTexture(),
      uniforms: {
        centre: uniform("centre"),
        shift: uniform("shift"),
        size: uniform("size"),
        scale: uniform("scale"),
        cell: uniform("cell"),
        turn: uniform("turn"),
        tilt: uniform("tilt"),
        eye: uniform("eye"),
      },
    };
    this.stale = this.recolour = true;
  }

  remove(): void {
    clearTimeout(this.timer);
    if (this.frame !== undefined) cancelAnimationFrame(this.frame);
    this.map.off("render", this.onMapDrawn);
    this.canvas.removeEventListener("webglcontextlost", this.onLost);
    this.canvas.removeEventListener("webglcontextrestored", this.onRestored);
    // A browser keeps but a few contexts: this one must not wait for the collector.
    this.made?.gl.getExtension("WEBGL_lose_context")?.loseContext();
    this.made = undefined;
    this.canvas.remove();
  }

  private draw(): void {
    const { map, made } = this;
    if (made === undefined) return;
    const { gl } = made;
    const view = viewOf(map);
    this.resize(view);
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (view.zoom < SITE_ZOOM) return;
    const close = view.zoom >= CLOSE_ZOOM;
    const tilted = view.tilt !== undefined;
    const headings = view.zoom >= HEADING_ZOOM && this.fleet.counts.all <= CROWD;
    if (close !== this.close || tilted !== this.tilted || headings !== this.headings) this.stale = true;
    Object.assign(this, { close, tilted, headings });
    gl.bindVertexArray(made.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, made.buffer);
    if (this.stale) {
      this.stale = false;
      this.fill();
      gl.bufferData(gl.ARRAY_BUFFER, this.vertices.subarray(0, this.count * FLOATS), gl.DYNAMIC_DRAW);
    }
    const ratio = gl.drawingBufferWidth / Math.max(1, view.width);
    gl.useProgram(made.program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, made.texture);
    if (this.recolour) this.paintSymbols(gl, Math.max(1, ratio));
    const [x, y] = [Math.fround(view.x), Math.fround(view.y)];
    gl.uniform4f(made.uniforms.centre, x, y, view.x - x, view.y - y);
    gl.uniform2f(made.uniforms.shift, view.left, view.top);
    gl.uniform2f(made.uniforms.size, view.width, view.height);
    gl.uniform1f(made.uniforms.scale, view.scale);
    gl.uniform1f(made.uniforms.cell, CELL * ratio * (view.zoom < 12 ? 0.8 : 1));
    const [[cosTurn, sinTurn], [cosPitch, sinPitch]] = [view.tilt?.turn ?? [1, 0], view.tilt?.pitch ?? [1, 0]];
    gl.uniform4f(made.uniforms.tilt, cosTurn, sinTurn, cosPitch, sinPitch);
    gl.uniform2f(made.uniforms.eye, view.tilt?.away ?? view.height, view.tilt?.perMetre ?? 0);
    const turn = this.calm ? 0 : ((performance.now() % TURN_MS) / TURN_MS) * 2 * Math.PI;
    gl.uniform2f(made.uniforms.turn, Math.cos(turn), Math.sin(turn));
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    if (this.wedges > 0) gl.drawArrays(gl.POINTS, 0, this.wedges);
    gl.drawArrays(gl.POINTS, this.wedges, this.count - this.wedges);
    this.keepTurning();
  }

  private resize({ width, height }: View): void {
    const ratio = this.map.getPixelRatio();
    const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width === wide && this.canvas.height === high) return;
    this.canvas.width = wide;
    this.canvas.height = high;
    this.canvas.style.width = `${width}px`;
    this.canvas.style.height = `${height}px`;
  }

  /** The arcs turn while something is being proved; in a crowd only as the drones move, which is often enough. */
  private keepTurning(): void {
    if (!this.turning || this.calm || this.count > CROWD || this.timer !== undefined) return;
    this.timer = setTimeout(() => {
      this.timer = undefined;
      this.schedule();
    }, TURN_FRAME_MS);
  }

  /** The vertices in the order of drawing. */
  private fill(): void {
    const { x, y } = this.store.tracks;
    const { looks } = this.fleet;
    const extent = Math.min(looks.length, this.store.tracks.extent);
    // A heading for each, and two halos.
    const most = (this.headings ? 2 : 1) * extent + 2;
    if (this.vertices.length < most * FLOATS) this.vertices = new Float32Array(most * 2 * FLOATS);
    const { vertices } = this;
    let n = 0;
    const put = (slot: number, look: number, size: number, heading = 0): void => {
      const [px = 0, py = 0] = [x[slot], y[slot]];
      const at = n * FLOATS;
      const [hx, hy] = [Math.fround(px), Math.fround(py)];
      vertices[at] = hx;
      vertices[at + 1] = hy;
      vertices[at + 2] = px - hx;
      vertices[at + 3] = py - hy;
      vertices[at + 4] = look;
      vertices[at + 5] = size;
      vertices[at + 6] = this.tilted ? upOf(this.store, slot) : 0;
      vertices[at + 7] = heading;
      n += 1;
    };
    const heard = this.fleet.counts.all > CROWD ? SMALL : 1;
    this.turning = false;
    for (let slot = 0; this.headings && slot < extent; slot++) {
      const heading = this.store.tracks.headingAt(slot);
      if (looks[slot] === HIDDEN || heading === undefined || (this.store.tracks.speedAt(slot) ?? 0) < FLYING_MM_S) continue;
      put(slot, HEADING, HEADING_SIZE, (heading / 18_000) * Math.PI);
    }
    this.wedges = n;
    const { selected, hovered } = this.marked;
    if (hovered !== undefined && hovered !== selected) put(hovered, HOVERED, HALO);
    if (selected !== undefined) put(selected, SELECTED, HALO);
    for (const code of DRAWN) {
      const look = this.close && !this.tilted && code < PROVING ? CLAIMS_FROM + code : code;
      const size = code > PROVING ? heard : 1;
      for (let slot = 0; slot < extent; slot++) {
        if (looks[slot] !== code || looks[slot] === HIDDEN) continue;
        put(slot, look, slot === selected ? 1 : size);
        if (code === PROVING) this.turning = true;
      }
    }
    this.count = n;
  }

  private paintSymbols(gl: WebGL2RenderingContext, ratio: number): void {
    this.recolour = false;
    const side = Math.ceil(CELL * Math.min(3, ratio) * 1.5);
    const { count, pixels } = drawAtlas(palette(MAP_COLOURS), side);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    // A layer for each, so that the smaller levels of one do not take the colour of another.
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA, side, side, count, 0, gl.RGBA, gl.UNSIGNED_BYTE, premultiplied(pixels));
    gl.generateMipmap(gl.TEXTURE_2D_ARRAY);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_NEAREST);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  }
}

/** WebGL premultiplies pictures, not arrays. */
function premultiplied(pixels: Uint8Array): Uint8Array {
  for (let i = 0; i < pixels.length; i += 4) {
    const alpha = (pixels[i + 3] ?? 0) / 255;
    for (let channel = i; channel < i + 3; channel++) pixels[channel] = Math.round((pixels[channel] ?? 0) * alpha);
  }
  return pixels;
}

function link(gl: WebGL2RenderingContext): WebGLProgram {
  const program = gl.createProgram();
  for (const [type, source] of [
    [gl.VERTEX_SHADER, VERTEX],
    [gl.FRAGMENT_SHADER, FRAGMENT],
  ] as const) {
    const shader = gl.createShader(type);
    if (shader === null) throw new Error("the graphics context is lost");
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    gl.deleteShader(shader);
  }
  gl.linkProgram(program);
  if (gl.getProgramParameter(program, gl.LINK_STATUS) !== true && !gl.isContextLost()) {
    throw new Error(`the drones' shaders do not link: ${gl.getProgramInfoLog(program) ?? ""}`);
  }
  return program;
}
