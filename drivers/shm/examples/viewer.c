/* Prints the hottest pixel of a stream, a few times a second.
 *
 *   cc -std=c11 viewer.c $(pkg-config --cflags --libs bolo-client) -o viewer
 *   ./viewer front          until Ctrl-C
 *   ./viewer front 20       20 lines
 */
#include <bolo/client.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

enum { OPEN_TIMEOUT_MS = 5000, FRAME_TIMEOUT_MS = 500, FRAMES_PER_LINE = 40 };

static volatile sig_atomic_t interrupted = 0;

static void interrupt(int number) {
  (void)number;
  interrupted = 1;
}

static void print_stream(const struct bolo_client_info* info) {
  printf("%s %s, %ux%u at %.0f Hz: %s\n", info->camera_model, info->camera_serial, (unsigned)info->width,
         (unsigned)info->height, 1.0 / info->frame_period_s, info->solver);
}

/* Reads the plane where it lies in the shared memory. */
static size_t hottest_pixel(const struct bolo_client_frame* frame) {
  const size_t pixels = (size_t)frame->width * frame->height;
  size_t hottest = 0;
  for (size_t i = 1; i < pixels; ++i) {
    if (frame->deblurred[i] > frame->deblurred[hottest]) hottest = i;
  }
  return hottest;
}

static void print_hottest(bolo_client* camera, const struct bolo_client_frame* frame, unsigned long long missed) {
  const size_t pixel = hottest_pixel(frame);
  const uint16_t value = frame->deblurred[pixel];
  float kelvin = 0.0F;
  if (!bolo_client_valid(frame)) return; /* overwritten while we looked */
  const unsigned x = (unsigned)(pixel % frame->width);
  const unsigned y = (unsigned)(pixel / frame->width);
  if (bolo_client_kelvin(camera, &value, 1, &kelvin) == BOLO_CLIENT_OK) {
    printf("frame %llu: %.2f C at (%u, %u), %llu missed\n", (unsigned long long)frame->number, kelvin - 273.15F, x, y,
           missed);
  } else {
    printf("frame %llu: count %u at (%u, %u), %llu missed\n", (unsigned long long)frame->number, (unsigned)value, x, y,
           missed);
  }
  fflush(stdout);
}

/* 0 when all lines were printed, 1 after an error. */
static int watch(bolo_client* camera, long lines) {
  struct bolo_client_frame frame;
  unsigned long long missed = 0;
  unsigned long seen = 0;
  while (!interrupted && lines != 0) {
    switch (bolo_client_next(camera, FRAME_TIMEOUT_MS, &frame)) {
      case BOLO_CLIENT_OK:
        missed += frame.missed;
        if (seen++ % FRAMES_PER_LINE != 0) break;
        print_hottest(camera, &frame, missed);
        if (lines > 0) --lines;
        break;
      case BOLO_CLIENT_RESTARTED:
        print_stream(bolo_client_get_info(camera));
        break;
      case BOLO_CLIENT_TIMEOUT:
        fprintf(stderr, "viewer: no frames\n");
        break;
      case BOLO_CLIENT_ENDED: /* the daemon may come back */
        fprintf(stderr, "viewer: %s\n", bolo_client_error(camera));
        break;
      default:
        fprintf(stderr, "viewer: %s\n", bolo_client_error(camera));
        return 1;
    }
  }
  return 0;
}

int main(int argc, char** argv) {
  bolo_client* camera = NULL;
  int result;
  if (argc < 2) {
    fprintf(stderr, "usage: viewer NAME [LINES]\n");
    return 2;
  }
  signal(SIGINT, interrupt);
  if (bolo_client_open(argv[1], OPEN_TIMEOUT_MS, &camera) != BOLO_CLIENT_OK) {
    fprintf(stderr, "viewer: %s\n", bolo_client_error(NULL));
    return 1;
  }
  print_stream(bolo_client_get_info(camera));
  result = watch(camera, argc > 2 ? strtol(argv[2], NULL, 10) : -1);
  bolo_client_close(camera);
  return result;
}
