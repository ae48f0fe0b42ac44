#version 330 core
// Where a point of the scene appears behind the eye's bending lens, and how much light it gets: diffuse lamps at
// infinity, no highlights, no gamma.  The image's first row is the framebuffer's first row.
// Defined before this is compiled: N_LAMPS, LAMPS, STRENGTHS, AMBIENT.
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 paint;

uniform mat4 T_root_mesh;
uniform mat4 T_camera_root;
uniform mat4 T_lamp_root; // to the shadow map, 0–1
uniform float lens[10];   // fx, fy, cx, cy in halves of the image; k1, k2, p1, p2, k3; largest r² that the image shows
uniform vec2 planes;      // near and far, m

out vec3 colour;
out vec2 light; // of the key lamp, which casts the shadows, and all the rest
out vec3 at_lamp;

vec2 bend(vec3 p) // times the depth; beyond the image the bending stays what it is at its corner
{
    float z = max(p.z, 1e-6);
    float r2 = dot(p.xy, p.xy) / (z * z);
    float s = min(r2, lens[9]);
    vec2 c = p.xy / z * sqrt(s / max(r2, 1e-12));
    float radial = 1.0 + s * (lens[4] + s * (lens[5] + s * lens[8]));
    vec2 tangential = vec2(
        2.0 * lens[6] * c.x * c.y + lens[7] * (s + 2.0 * c.x * c.x),
        lens[6] * (s + 2.0 * c.y * c.y) + 2.0 * lens[7] * c.x * c.y);
    return p.xy * radial + tangential * z;
}

void main()
{
    vec4 at = T_root_mesh * vec4(position, 1.0);
    vec3 p = (T_camera_root * at).xyz;
    vec2 xy = vec2(lens[0], lens[1]) * bend(p) + vec2(lens[2], lens[3]) * p.z;
    float depth = ((planes.y + planes.x) * p.z - 2.0 * planes.x * planes.y) / (planes.y - planes.x);
    gl_Position = vec4(xy, depth, p.z);

    vec3 n = normalize(mat3(T_root_mesh) * normal);
    light = vec2(0.0, AMBIENT);
#if N_LAMPS > 0
    const vec3 lamps[N_LAMPS] = vec3[N_LAMPS](LAMPS);
    const float strengths[N_LAMPS] = float[N_LAMPS](STRENGTHS);
    float facing = dot(n, lamps[0]);
    light.x = strengths[0] * max(facing, 0.0);
    light.y += 0.12 * min(facing, 0.0); // the floor below is the darkest part of a room
    for (int k = 1; k < N_LAMPS; k++)
        light.y += strengths[k] * max(dot(n, lamps[k]), 0.0);
#endif
    colour = paint;
#ifdef SHADOWS
    at_lamp = (T_lamp_root * at).xyz;
#endif
}
