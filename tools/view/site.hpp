// The view's HTTP resources: the page, and its data.
//
//   GET  /                         the page of the only camera, or of all side by side; other files by their names
//   GET  /camera/NAME/...          what follows, of one of several cameras
//   GET  /api/cameras              names of the cameras
//   GET  /api/frame?epoch=E&after=N   waits for another frame than N of E: FrameHead and planes; 204 when none comes
//   GET  /api/trace?x=X&y=Y&epoch=E&after=N   samples of a pixel from frame N of E on
//   GET  /api/status               rates, latency, losses, camera
//   POST /api/nuc                  has the camera correct its pixels: 202; the status says what came of it
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "src/core/result.hpp"
#include "src/core/threads.hpp"
#include "tools/view/http.hpp"
#include "tools/view/live_stream.hpp"

namespace bolo::view {

// --- The files of the page, built into the program.

struct PageFile {
  std::string_view name;  // as in tools/view/page
  std::string_view content;
};

// Thread: any.
std::span<const PageFile> page_files();

// --- Access control. A browser sends requests to loopback on behalf of any page that it shows, and any user of this
// computer can connect, whatever he may read of shared memory and control socket: local clients are not trusted for
// being local.

struct Access {
  std::string token;             // that every request has to bring; an empty one lets nobody in
  bool beyond_loopback = false;  // other computers may connect: they name this one by its address or its host name
  std::string host_name{};
  std::uint16_t port = 0;
};

// Good tokens have 16 to 128 letters, digits, '-' and '_'. Thread: any.
Status check_token(const std::string& token);
// 32 letters that nobody can guess. Thread: setup.
Result<std::string> random_token();
// The first line of a file that only its owner may read. Thread: setup.
Result<std::string> read_token(const std::string& file);

// The refusal of a request: 400 (no Host), 403 (a Host that is not this computer: DNS rebinding; another site's
// page; a change without an Origin that is this page), 401 (no token). Nothing: it may pass. Thread: any.
std::optional<Answer> refusal(const Access& access, const Request& request);

// The cookie to be set for a request that brought the token as ?token=; nothing otherwise. Thread: any.
std::optional<std::string> cookie_for(const Access& access, const Request& request);

// True if a Host header ("localhost:8640", "[::1]") names this computer. Thread: any.
bool is_this_computer(const Access& access, const std::string& host);

// --- Requests a NUC without blocking the caller: one at a time. Thread: one at a time.

class NucTrigger {
 public:
  // Asks and waits for the answer; called on a thread of the asker's.
  using Ask = std::function<Status()>;

  explicit NucTrigger(Ask ask) : ask_(std::move(ask)) {}

  // False while the one before is not answered.
  bool start() {
    if (pending()) return false;
    try {
      answer_ = std::async(std::launch::async, ask_).share();
    } catch (const std::system_error& e) {
      std::promise<Status> none;
      none.set_value(failed("the camera was not asked: " + describe_exception(e)));
      answer_ = none.get_future().share();
    }
    return true;
  }
  bool pending() const {
    return answer_.valid() && answer_.wait_for(std::chrono::seconds(0)) != std::future_status::ready;
  }
  // Why the last one was not made; empty: it was, or none was asked for.
  std::string trouble() const {
    if (!answer_.valid() || pending() || answer_.get()) return {};
    return answer_.get().error().message;
  }

 private:
  const Ask ask_;
  std::shared_future<Status> answer_;  // its end waits for it
};

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
    std::unique_ptr<NucTrigger> nuc;
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
