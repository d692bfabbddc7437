// HTTP resources of the view: the page and its data.
//
//   GET  /                         the page of the only camera, or of all side by side; other files by name
//   GET  /camera/NAME/...          any of the following, for one of several cameras
//   GET  /api/cameras              names of the cameras
//   GET  /api/frame?epoch=E&after=N   waits for a frame other than N of E: FrameHead and planes; 204 on timeout
//   GET  /api/trace?x=X&y=Y&epoch=E&after=N   samples of a pixel from frame N of E on
//   GET  /api/status               rates, latency, losses, camera
//   POST /api/nuc                  requests a NUC: 202; the outcome is in the status
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
// computer can connect, whatever their rights to shared memory and control socket: local clients are not trusted.

struct Access {
  std::string token;             // required in every request; if empty, all are refused
  bool beyond_loopback = false;  // other computers may connect, by this one's address or host name
  std::string host_name{};
  std::uint16_t port = 0;
};

// Valid tokens have 16 to 128 letters, digits, '-' and '_'. Thread: any.
Status check_token(const std::string& token);
// 32 letters, unpredictable. Thread: setup.
Result<std::string> random_token();
// The first line of a file that only its owner can read. Thread: setup.
Result<std::string> read_token(const std::string& file);

// The refusal of a request: 400 (no Host), 403 (Host is not this computer: DNS rebinding; another site's page; a change
// whose Origin is not this page), 401 (no token). Nothing: accepted. Thread: any.
std::optional<Answer> refusal(const Access& access, const Request& request);

// The cookie to set if the request brought the token as ?token=; otherwise nothing. Thread: any.
std::optional<std::string> cookie_for(const Access& access, const Request& request);

// True if a Host header ("localhost:8640", "[::1]") names this computer. Thread: any.
bool is_this_computer(const Access& access, const std::string& host);

// --- Requests a NUC without blocking the caller, one at a time. Thread: one at a time.

class NucTrigger {
 public:
  // Sends the request and waits for the answer; called on a separate thread.
  using Ask = std::function<Status()>;

  explicit NucTrigger(Ask ask) : ask_(std::move(ask)) {}

  // False while the last request is pending.
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
  // The error of the last request; empty: it succeeded, or there was none.
  std::string trouble() const {
    if (!answer_.valid() || pending() || answer_.get()) return {};
    return answer_.get().error().message;
  }

 private:
  const Ask ask_;
  std::shared_future<Status> answer_;  // its destructor waits for the thread
};

class Site {
 public:
  // `ask_for_nuc` gets the camera's name. `page_folder`: files are read from there at each request, under the names of
  // the built-in ones; empty: the built-in ones are served. Thread: setup.
  using Ask = std::function<Status(const std::string&)>;
  Site(Access access, const std::vector<LiveStream*>& streams, const Ask& ask_for_nuc,
       std::filesystem::path page_folder);

  // HttpServer's handler. Thread: one at a time.
  std::optional<Answer> answer(const Request& request);

  // Headers of every answer, which restrict the browser.
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
