#version 330 core
struct Material {
    sampler2D base_color_texture;
};
uniform Material material;
in vec3 light;
#ifdef TEXCOORD_0_LOC
in vec2 uv;
#endif
out vec4 frag_color;

void main()
{
    vec3 color = light;
#ifdef HAS_BASE_COLOR_TEX
    color *= texture(material.base_color_texture, uv).rgb;
#endif
    frag_color = vec4(color, 1.0);
}
