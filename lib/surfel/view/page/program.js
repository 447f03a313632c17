// Programs of the graphics processor.

/** A linked program with its uniforms by name. */
export class Program {
  constructor(gl, vertex, fragment) {
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text.trim());
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) {
      const logs = gl.getAttachedShaders(this.program).map((s) => gl.getShaderInfoLog(s));
      logs.push(gl.getProgramInfoLog(this.program));
      throw new Error(`The graphics driver refuses a program: ${logs.join('')}`);
    }
    this.uniforms = {};
    const count = gl.getProgramParameter(this.program, gl.ACTIVE_UNIFORMS);
    for (let i = 0; i < count; ++i) {
      const { name, type } = gl.getActiveUniform(this.program, i);
      this.uniforms[name.replace('[0]', '')] = { type, at: gl.getUniformLocation(this.program, name) };
    }
  }

  /** Makes the program the current one, with these values of uniforms; textures by their names. */
  use(values) {
    const { gl } = this;
    gl.useProgram(this.program);
    let unit = 0;
    for (const [name, { type, at }] of Object.entries(this.uniforms)) {
      const value = values[name];
      if (type === gl.SAMPLER_2D || type === gl.UNSIGNED_INT_SAMPLER_2D) {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, value);
        gl.uniform1i(at, unit++);
      } else if (type === gl.FLOAT) {
        gl.uniform1fv(at, [].concat(value));
      } else if (type === gl.FLOAT_VEC2) {
        gl.uniform2fv(at, value);
      } else if (type === gl.FLOAT_VEC3) {
        gl.uniform3fv(at, value);
      } else if (type === gl.FLOAT_VEC4) {
        gl.uniform4fv(at, value);
      } else if (type === gl.FLOAT_MAT3) {
        gl.uniformMatrix3fv(at, false, value);
      } else if (type === gl.INT_VEC2) {
        gl.uniform2iv(at, value);
      } else {
        gl.uniform1i(at, value ? Number(value) : 0);
      }
    }
  }
}
