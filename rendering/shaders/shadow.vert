#version 330 core
// What the key lamp sees: depth only.
layout(location = 0) in vec3 position;
uniform mat4 T_root_mesh;
uniform mat4 T_lamp_root; // to the shadow map, 0–1

void main()
{
    gl_Position = vec4(2.0 * (T_lamp_root * T_root_mesh * vec4(position, 1.0)).xyz - 1.0, 1.0);
}
