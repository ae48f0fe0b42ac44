#version 330 core
// Diffuse light from one fixed lamp, per vertex: half as costly as pyrender's own shader, no highlights, no gamma.
const vec3 TO_LAMP = vec3(0.474, 0.237, 0.848); // root frame: above the robot's head, a little to its right

layout(location = 0) in vec3 position;
layout(location = NORMAL_LOC) in vec3 normal;
#ifdef TEXCOORD_0_LOC
layout(location = TEXCOORD_0_LOC) in vec2 texcoord_0;
out vec2 uv;
#endif
#ifdef COLOR_0_LOC
layout(location = COLOR_0_LOC) in vec4 color_0;
#endif

uniform mat4 M;
uniform mat4 V;
uniform mat4 P;
out vec3 light;

void main()
{
    gl_Position = P * V * M * vec4(position, 1.0);
    float facing = dot(normalize(mat3(M) * normal), TO_LAMP);
    light = vec3(0.62 + 0.38 * max(facing, 0.0) + 0.12 * min(facing, 0.0));
#ifdef COLOR_0_LOC
    light *= color_0.rgb;
#endif
#ifdef TEXCOORD_0_LOC
    uv = texcoord_0;
#endif
}
