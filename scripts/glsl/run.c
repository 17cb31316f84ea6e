// Renders a fragment shader without a window and prints the seconds of each run: what scripts/performance.py compares with.
//
//   cc -O2 -o run run.c -lEGL -lGLESv2
//   ./run RUNS WIDTH HEIGHT OUT.ppm PART.frag...     (the parts are joined; OUT.ppm may be - for none)
//
// First line: the renderer's name. Then one line a run: seconds from the draw call until all pixels have come back.
#define _POSIX_C_SOURCE 199309L
#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GLES3/gl3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static void fail(const char *what) {
    fprintf(stderr, "run: %s\n", what);
    exit(1);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static char *read_all(int count, char **names) {
    size_t length = 0;
    char *text = calloc(1, 1);
    for (int i = 0; i < count; i++) {
        FILE *file = fopen(names[i], "rb");
        if (!file) fail(names[i]);
        fseek(file, 0, SEEK_END);
        size_t more = (size_t)ftell(file);
        rewind(file);
        text = realloc(text, length + more + 1);
        if (!text || fread(text + length, 1, more, file) != more) fail(names[i]);
        length += more;
        text[length] = 0;
        fclose(file);
    }
    return text;
}

static void open_context(void) {
    PFNEGLGETPLATFORMDISPLAYEXTPROC get =
        (PFNEGLGETPLATFORMDISPLAYEXTPROC)eglGetProcAddress("eglGetPlatformDisplayEXT");
    EGLDisplay display =
        get ? get(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL) : eglGetDisplay(EGL_DEFAULT_DISPLAY);
    if (display == EGL_NO_DISPLAY || !eglInitialize(display, NULL, NULL)) fail("EGL does not start");
    const EGLint wanted[] = {EGL_RENDERABLE_TYPE, EGL_OPENGL_ES3_BIT, EGL_SURFACE_TYPE, 0, EGL_NONE};
    EGLConfig config;
    EGLint found = 0;
    if (!eglChooseConfig(display, wanted, &config, 1, &found) || found < 1) fail("EGL has no configuration");
    eglBindAPI(EGL_OPENGL_ES_API);
    const EGLint version[] = {EGL_CONTEXT_CLIENT_VERSION, 3, EGL_NONE};
    EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, version);
    if (!context || !eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) fail("EGL gives no context");
}

static GLuint compile(GLenum kind, const char *text) {
    GLuint shader = glCreateShader(kind);
    glShaderSource(shader, 1, &text, NULL);
    glCompileShader(shader);
    GLint ok = 0;
    glGetShaderiv(shader, GL_COMPILE_STATUS, &ok);
    if (!ok) {
        char log[4000];
        glGetShaderInfoLog(shader, sizeof log, NULL, log);
        fail(log);
    }
    return shader;
}

static GLuint link_program(const char *fragment) {
    const char *vertex = "#version 300 es\nvoid main() {\n"
                         "  vec2 corner = vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1));\n"
                         "  gl_Position = vec4(corner * 4.0 - 1.0, 0.0, 1.0);\n}\n";
    GLuint program = glCreateProgram();
    glAttachShader(program, compile(GL_VERTEX_SHADER, vertex));
    glAttachShader(program, compile(GL_FRAGMENT_SHADER, fragment));
    glLinkProgram(program);
    GLint ok = 0;
    glGetProgramiv(program, GL_LINK_STATUS, &ok);
    if (!ok) fail("the shader does not link");
    return program;
}

static void write_picture(const char *name, int width, int height, const unsigned char *pixels) {
    FILE *file = fopen(name, "wb");
    if (!file) fail(name);
    fprintf(file, "P6 %d %d 255\n", width, height);
    for (int y = height - 1; y >= 0; y--)
        for (int x = 0; x < width; x++) fwrite(pixels + 4 * ((size_t)y * (size_t)width + (size_t)x), 1, 3, file);
    fclose(file);
}

int main(int count, char **words) {
    if (count < 6) fail("usage: run RUNS WIDTH HEIGHT OUT.ppm PART.frag...");
    int runs = atoi(words[1]), width = atoi(words[2]), height = atoi(words[3]);
    if (runs < 1 || width < 1 || height < 1) fail("runs, width and height are whole numbers above 0");
    char *text = read_all(count - 5, words + 5);
    open_context();
    printf("%s\n", (const char *)glGetString(GL_RENDERER));
    GLuint frame, target;
    glGenFramebuffers(1, &frame);
    glGenRenderbuffers(1, &target);
    glBindRenderbuffer(GL_RENDERBUFFER, target);
    glRenderbufferStorage(GL_RENDERBUFFER, GL_RGBA8, width, height);
    glBindFramebuffer(GL_FRAMEBUFFER, frame);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, target);
    glViewport(0, 0, width, height);
    GLuint program = link_program(text);
    glUseProgram(program);
    glUniform2f(glGetUniformLocation(program, "size"), (float)width, (float)height);
    unsigned char *pixels = malloc(4 * (size_t)width * (size_t)height);
    if (!pixels) fail("too little memory");
    // The first run also compiles for the machine; it is not printed.
    for (int i = 0; i <= runs; i++) {
        double start = now();
        glDrawArrays(GL_TRIANGLES, 0, 3);
        glReadPixels(0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, pixels);
        if (i > 0) printf("%.6f\n", now() - start);
    }
    if (glGetError() != GL_NO_ERROR) fail("OpenGL reports an error");
    if (strcmp(words[4], "-") != 0) write_picture(words[4], width, height, pixels);
    return 0;
}
