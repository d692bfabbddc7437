// Solves single pixels of a stream on demand, as a tracker of keypoints would, and prints their temperatures.
//
//   points NAME FRAMES X,Y [X,Y ...]
#include <bolo/client.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <vector>

namespace {

constexpr int kOpenTimeoutMs = 5000;
constexpr int kFrameTimeoutMs = 1000;

struct Close {
  void operator()(bolo_client* client) const { bolo_client_close(client); }
};
using Camera = std::unique_ptr<bolo_client, Close>;

Camera open_camera(const char* name) {
  bolo_client* client = nullptr;
  bolo_client_open(name, kOpenTimeoutMs, &client);
  return Camera(client);
}

std::vector<bolo_client_point> points_of(char** first, char** last) {
  std::vector<bolo_client_point> points;
  for (; first != last; ++first) {
    bolo_client_point point{};
    if (std::sscanf(*first, "%u,%u", &point.x, &point.y) == 2) points.push_back(point);
  }
  return points;
}

// Prints the frame whose look-ahead ends with the newest one. Prints nothing unless the result is BOLO_CLIENT_OK.
int print_points(bolo_client* camera, std::uint64_t newest, const std::vector<bolo_client_point>& points) {
  const std::uint64_t lookahead = bolo_client_get_info(camera)->lookahead;
  if (newest < lookahead) return BOLO_CLIENT_NOT_YET;
  std::vector<float> values(points.size());
  const std::uint64_t number = newest - lookahead;
  const int result = bolo_client_points(camera, number, points.data(), points.size(), values.data());
  if (result != BOLO_CLIENT_OK) return result;
  std::printf("frame %llu:", static_cast<unsigned long long>(number));
  for (const float value : values) std::printf(" %.3f", static_cast<double>(value));
  std::puts("");
  return BOLO_CLIENT_OK;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<bolo_client_point> points =
      argc > 3 ? points_of(argv + 3, argv + argc) : std::vector<bolo_client_point>();
  if (points.empty() || points.size() != static_cast<std::size_t>(argc - 3)) {
    std::fprintf(stderr, "usage: points NAME FRAMES X,Y [X,Y ...]\n");
    return 2;
  }
  const Camera camera = open_camera(argv[1]);
  if (!camera) {
    std::fprintf(stderr, "points: %s\n", bolo_client_error(nullptr));
    return 1;
  }
  bolo_client_frame frame{};
  for (long left = std::atol(argv[2]); left > 0;) {
    int result = bolo_client_latest(camera.get(), kFrameTimeoutMs, &frame);
    if (result == BOLO_CLIENT_RESTARTED) continue;  // other frames, same points
    if (result == BOLO_CLIENT_OK) {
      result = print_points(camera.get(), frame.number, points);
      if (result == BOLO_CLIENT_OK) --left;
      if (result >= 0) continue;  // negative: a point outside the frame, or a stream whose points cannot be solved
    }
    std::fprintf(stderr, "points: %s\n", result == BOLO_CLIENT_TIMEOUT ? "no frames" : bolo_client_error(camera.get()));
    return 1;
  }
  return 0;
}
