// What the view answers: the page, and what the page asks for.
//
//   GET  /                         the page of the only camera, or of all side by side; other files by their names
//   GET  /camera/NAME/...          what follows, of one of several cameras
//   GET  /api/cameras              names of the cameras
//   GET  /api/frame?epoch=E&after=N   waits for another frame than N of E: FrameHead and planes; 204 when none comes
//   GET  /api/trace?x=X&y=Y&epoch=E&after=N   samples of a pixel from frame N of E on
//   GET  /api/status               rates, latency, losses, camera
//   POST /api/nuc                  has the camera correct its pixels: 202; the status says what came of it
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tools/view/access.hpp"
#include "tools/view/http.hpp"
#include "tools/view/live_stream.hpp"
#include "tools/view/nuc_asker.hpp"

namespace bolo::view {

class Site {
 public:
  // `ask_for_nuc` is given the camera's name. `page_folder`: files are read from there at each request, under the names
  // of the built-in ones; empty: those are served. Thread: setup.
  using Ask = std::function<Status(const std::string&)>;
  Site(Access access, const std::vector<LiveStream*>& streams, const Ask& ask_for_nuc,
       std::filesystem::path page_folder);

  // HttpServer's handler. Thread: one at a time.
  std::optional<Answer> answer(const Request& request);

  // Headers of every answer: what a browser may do with it.
  static std::vector<std::pair<std::string, std::string>> headers();

 private:
  struct Camera {
    LiveStream& stream;
    std::unique_ptr<NucAsker> nuc;
  };

  std::optional<Answer> route(const Request& request);
  Camera* camera_of(std::string& path);
  Answer page(const std::string& path, bool of_one) const;
  Answer cameras() const;

  const Access access_;
  const std::filesystem::path page_folder_;
  std::vector<Camera> cameras_;
};

}  // namespace bolo::view
