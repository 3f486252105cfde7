// A pile that `cairn pack` wrote, in three.js: each prop is one draw call per material, and a vertex shader reads where
// each body is from the textures of the motion. Nothing is computed per body in JavaScript.
import { FloatType, Matrix4, NearestFilter } from "three";
import { EXRLoader } from "three/examples/jsm/loaders/EXRLoader.js";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
import { MeshoptDecoder } from "three/examples/jsm/libs/meshopt_decoder.module.js";

// The shader, for other engines to take over: a column is a frame, a row is a body, and after `rows` bodies they go on
// `frames` columns further. `cairn_moment`: the frame before, the frame after, and how far it is between them.
export const POSE = /* glsl */ `
uniform highp sampler2D cairn_positions; // X, Y, Z in metres; alpha: the scale, 0 before the body appears
uniform highp sampler2D cairn_rotations; // a unit quaternion X, Y, Z, W
uniform ivec3 cairn_layout; // frames, rows, height
uniform vec3 cairn_moment;

ivec2 cairn_texel(float frame, float body) {
  int row = int(body + 0.5) % cairn_layout.y;
  int column = int(body + 0.5) / cairn_layout.y;
  // The loader of three.js puts the top row last.
  return ivec2(int(frame + 0.5) + column * cairn_layout.x, cairn_layout.z - 1 - row);
}

vec3 cairn_turned(vec4 q, vec3 v) {
  return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}

vec4 cairn_rotation(float body) {
  vec4 from = texelFetch(cairn_rotations, cairn_texel(cairn_moment.x, body), 0);
  vec4 to = texelFetch(cairn_rotations, cairn_texel(cairn_moment.y, body), 0);
  return normalize(mix(from, dot(from, to) < 0.0 ? -to : to, cairn_moment.z));
}

// A point of a body, in its own frame, where it is now.
vec3 cairn_posed(vec3 point, float body) {
  vec4 from = texelFetch(cairn_positions, cairn_texel(cairn_moment.x, body), 0);
  vec4 to = texelFetch(cairn_positions, cairn_texel(cairn_moment.y, body), 0);
  return mix(from.xyz, to.xyz, cairn_moment.z) + from.w * cairn_turned(cairn_rotation(body), point);
}
`;

// A pack, ready to be added to a scene: `object`, its length in `seconds`, and `show(seconds)`.
export async function loadPile(folder) {
  const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder);
  const exr = new EXRLoader().setDataType(FloatType);
  const [manifest, { scene }, positions, rotations] = await Promise.all([
    fetch(`${folder}/manifest.json`).then((answer) => answer.json()),
    loader.loadAsync(`${folder}/instances.glb`),
    exr.loadAsync(`${folder}/motion.positions.exr`),
    exr.loadAsync(`${folder}/motion.rotations.exr`),
  ]);
  for (const texture of [positions, rotations]) {
    texture.minFilter = texture.magFilter = NearestFilter;
    texture.generateMipmaps = false;
  }
  const { fps, frames, rows, height } = manifest.motion;
  const uniforms = {
    cairn_positions: { value: positions },
    cairn_rotations: { value: rotations },
    cairn_layout: { value: [frames, rows, height] },
    cairn_moment: { value: [frames - 1, frames - 1, 0] },
  };
  scene.traverse((node) => {
    if (!node.isInstancedMesh) return;
    // The textures place each body, so that its own matrix does nothing.
    for (let i = 0; i < node.count; i++) node.setMatrixAt(i, new Matrix4());
    node.frustumCulled = false;
    node.material = node.material.clone();
    node.material.onBeforeCompile = (shader) => {
      Object.assign(shader.uniforms, uniforms);
      shader.vertexShader = shader.vertexShader
        .replace("#include <common>", `#include <common>\nattribute float _BODY;\n${POSE}`)
        .replace(
          "#include <beginnormal_vertex>",
          "#include <beginnormal_vertex>\nobjectNormal = cairn_turned(cairn_rotation(_BODY), objectNormal);",
        )
        .replace("#include <begin_vertex>", "vec3 transformed = cairn_posed(position, _BODY);");
    };
  });
  const seconds = (frames - 1) / fps;
  const show = (moment) => {
    const frame = Math.min(Math.max(moment, 0), seconds) * fps;
    const before = Math.min(Math.floor(frame), frames - 1);
    uniforms.cairn_moment.value = [before, Math.min(before + 1, frames - 1), frame - before];
  };
  show(seconds);
  return { object: scene, manifest, uniforms, seconds, show };
}
