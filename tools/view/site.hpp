// What the view answers: the page, and what the page asks for.
//
//   GET  /                         the page; other files of it by their names
//   GET  /api/frame?epoch=E&after=N   waits for another frame than N of E: FrameHead and planes; 204 when none comes
//   GET  /api/trace?x=X&y=Y&epoch=E&after=N   samples of a pixel from frame N of E on
//   GET  /api/status               rates, latency, losses, camera
//   POST /api/nuc                  has the camera correct its pixels: 202; the status says what came of it
#pragma once

#include <filesystem>
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
  // `page_folder`: files are read from there at each request, under the names of the built-in ones; empty: those are
  // served. Thread: setup.
  Site(Access access, LiveStream& stream, NucAsker::Ask ask_for_nuc, std::filesystem::path page_folder);

  // HttpServer's handler. Thread: one at a time.
  std::optional<Answer> answer(const Request& request);

  // Headers of every answer: what a browser may do with it.
  static std::vector<std::pair<std::string, std::string>> headers();

 private:
  std::optional<Answer> route(const Request& request);
  Answer page(const Request& request) const;
  std::optional<Answer> frame(const Request& request);
  Answer trace(const Request& request) const;
  Answer status() const;
  Answer nuc();

  const Access access_;
  LiveStream& stream_;
  const std::filesystem::path page_folder_;
  NucAsker nuc_;
};

}  // namespace bolo::view
