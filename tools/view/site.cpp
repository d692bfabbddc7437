#include "tools/view/site.hpp"

#include <algorithm>
#include <charconv>
#include <fstream>
#include <sstream>

#include "tools/view/page_files.hpp"

namespace bolo::view {
namespace {

constexpr std::chrono::milliseconds kFramePatience{2000};

// A whole number; nothing where it is missing or anything else.
template <typename Number>
std::optional<Number> number(const Request& request, const char* name) {
  const auto text = request.argument(name);
  Number value{};
  if (!text) return std::nullopt;
  const char* end = text->data() + text->size();
  const auto [rest, error] = std::from_chars(text->data(), end, value);
  return error == std::errc{} && rest == end ? std::optional<Number>(value) : std::nullopt;
}

std::optional<Place> place(const Request& request) {
  const auto epoch = number<std::uint64_t>(request, "epoch");
  const auto after = number<std::uint64_t>(request, "after");
  return epoch && after ? std::optional<Place>(Place{*epoch, *after}) : std::nullopt;
}

std::string type_of(std::string_view name) {
  const std::string_view ending = name.substr(name.rfind('.') + 1);
  if (ending == "html") return "text/html; charset=utf-8";
  if (ending == "css") return "text/css; charset=utf-8";
  if (ending == "js") return "text/javascript; charset=utf-8";
  return "image/svg+xml";
}

// Texts in shared memory may be cut within a letter.
Answer json_answer(const nlohmann::ordered_json& json) {
  return {.type = "application/json",
          .body = std::make_shared<const std::string>(
              json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace))};
}

std::string contents(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

}  // namespace

Site::Site(Access access, LiveStream& stream, NucAsker::Ask ask_for_nuc, std::filesystem::path page_folder)
    : access_(std::move(access)), stream_(stream), page_folder_(std::move(page_folder)), nuc_(std::move(ask_for_nuc)) {}

std::vector<std::pair<std::string, std::string>> Site::headers() {
  return {{"Content-Security-Policy",
           "default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; object-src 'none'"},
          {"X-Content-Type-Options", "nosniff"},
          {"Referrer-Policy", "no-referrer"},
          {"Cross-Origin-Resource-Policy", "same-origin"},
          {"Cache-Control", "no-store"}};
}

std::optional<Answer> Site::answer(const Request& request) {
  if (auto refused = refusal(access_, request)) return refused;
  auto answer = route(request);
  if (const auto cookie = cookie_for(access_, request); answer && cookie) {
    answer->headers.emplace_back("Set-Cookie", *cookie);
  }
  return answer;
}

std::optional<Answer> Site::route(const Request& request) {
  const bool post = request.path() == "/api/nuc";
  if (request.method() != (post ? "POST" : "GET")) {
    Answer refused = line(405, post ? "a NUC is asked for by POST" : "only GET is allowed here");
    refused.headers.emplace_back("Allow", post ? "POST" : "GET");
    return refused;
  }
  if (post) return nuc();
  if (request.path() == "/api/frame") return frame(request);
  if (request.path() == "/api/trace") return trace(request);
  if (request.path() == "/api/status") return status();
  return page(request);
}

Answer Site::page(const Request& request) const {
  const std::string& path = request.path();  // as it was sent: perhaps without a slash, or empty
  if (!path.starts_with('/')) return line(404, "there is no such page");
  const std::string name = path == "/" ? "index.html" : path.substr(1);
  const auto files = page_files();
  const auto file = std::find_if(files.begin(), files.end(), [&](const PageFile& f) { return f.name == name; });
  if (file == files.end()) return line(404, "there is no such page");
  const std::string content = page_folder_.empty() ? std::string(file->content) : contents(page_folder_ / file->name);
  return {.type = type_of(name), .body = std::make_shared<const std::string>(content)};
}

std::optional<Answer> Site::frame(const Request& request) {
  const auto seen = place(request);
  if (!seen) return line(400, "epoch and after must be whole numbers");
  if (auto body = stream_.newest_frame(*seen)) return Answer{.type = "application/octet-stream", .body = body};
  if (request.waited() < kFramePatience) return std::nullopt;
  return Answer{.status = 204};
}

Answer Site::trace(const Request& request) const {
  const auto x = number<std::uint32_t>(request, "x");
  const auto y = number<std::uint32_t>(request, "y");
  const auto seen = place(request);
  if (!x || !y || !seen) return line(400, "x, y, epoch and after must be whole numbers");
  const auto trace = stream_.trace(*x, *y, *seen);
  if (!trace) return line(404, "no stream, no such pixel in it, or too many pixels are followed");
  return json_answer(*trace);
}

Answer Site::status() const {
  nlohmann::ordered_json json = stream_.status();
  json["view"]["nuc_asking"] = nuc_.asking();
  json["view"]["nuc_trouble"] = nuc_.trouble();
  return json_answer(json);
}

Answer Site::nuc() {
  return nuc_.start() ? line(202, "the camera is asked") : line(409, "a NUC is being asked for already");
}

}  // namespace bolo::view
