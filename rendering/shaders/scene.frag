#version 330 core
// Paint times light.  Defined before this is compiled: TEXTURED, SHADOWS, or neither.
in vec3 colour;
in vec2 light;
in vec3 at_lamp;
uniform sampler2D atlas;
uniform sampler2DShadow shadow_map;
out vec4 seen;

void main()
{
    float sum = light.x + light.y;
#ifdef SHADOWS
    sum = light.x * texture(shadow_map, at_lamp) + light.y;
#endif
#ifdef TEXTURED
    seen = vec4(texture(atlas, colour.xy).rgb * sum, 1.0);
#else
    seen = vec4(colour * sum, 1.0);
#endif
}
