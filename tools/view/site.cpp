#include "tools/view/site.hpp"

#include <algorithm>
#include <charconv>

#include "src/core/input_file.hpp"
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

std::string contents(const std::filesystem::path& file) { return read_input(file).value_or(""); }

std::optional<Answer> frame(LiveStream& stream, const Request& request) {
  const auto seen = place(request);
  if (!seen) return line(400, "epoch and after must be whole numbers");
  if (auto body = stream.newest_frame(*seen)) return Answer{.type = "application/octet-stream", .body = body};
  if (request.waited() < kFramePatience) return std::nullopt;
  return Answer{.status = 204};
}

Answer trace(LiveStream& stream, const Request& request) {
  const auto x = number<std::uint32_t>(request, "x");
  const auto y = number<std::uint32_t>(request, "y");
  const auto seen = place(request);
  if (!x || !y || !seen) return line(400, "x, y, epoch and after must be whole numbers");
  const auto trace = stream.trace(*x, *y, *seen);
  if (!trace) return line(404, "no stream, no such pixel in it, or too many pixels are followed");
  return json_answer(*trace);
}

Answer status(LiveStream& stream, const NucAsker& nuc) {
  nlohmann::ordered_json json = stream.status();
  json["view"]["nuc_asking"] = nuc.asking();
  json["view"]["nuc_trouble"] = nuc.trouble();
  return json_answer(json);
}

Answer nuc(NucAsker& asker) {
  return asker.start() ? line(202, "the camera is asked") : line(409, "a NUC is being asked for already");
}

}  // namespace

Site::Site(Access access, const std::vector<LiveStream*>& streams, const Ask& ask_for_nuc,
           std::filesystem::path page_folder)
    : access_(std::move(access)), page_folder_(std::move(page_folder)) {
  for (LiveStream* stream : streams) {
    const auto ask = [ask_for_nuc, name = stream->name()] { return ask_for_nuc(name); };
    cameras_.push_back({*stream, std::make_unique<NucAsker>(ask)});
  }
}

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

// Takes "/camera/NAME" off the path. Null: the path is nobody's in particular; of a name that is not there it stays
// whole.
Site::Camera* Site::camera_of(std::string& path) {
  if (cameras_.size() == 1) return &cameras_.front();
  for (Camera& camera : cameras_) {
    const std::string prefix = "/camera/" + camera.stream.name();
    if (!path.starts_with(prefix + "/")) continue;
    path.erase(0, prefix.size());
    return &camera;
  }
  return nullptr;
}

std::optional<Answer> Site::route(const Request& request) {
  std::string path = request.path();
  Camera* camera = camera_of(path);
  const bool post = camera != nullptr && path == "/api/nuc";
  if (request.method() != (post ? "POST" : "GET")) {
    Answer refused = line(405, post ? "a NUC is asked for by POST" : "only GET is allowed here");
    refused.headers.emplace_back("Allow", post ? "POST" : "GET");
    return refused;
  }
  if (path == "/api/cameras") return cameras();
  if (camera == nullptr) return page(path, false);
  if (post) return nuc(*camera->nuc);
  if (path == "/api/frame") return frame(camera->stream, request);
  if (path == "/api/trace") return trace(camera->stream, request);
  if (path == "/api/status") return status(camera->stream, *camera->nuc);
  return page(path, true);
}

Answer Site::cameras() const {
  nlohmann::ordered_json names = nlohmann::ordered_json::array();
  for (const Camera& camera : cameras_) names.push_back(camera.stream.name());
  return json_answer(names);
}

Answer Site::page(const std::string& path, bool of_one) const {
  if (!path.starts_with('/')) return line(404, "there is no such page");  // as it was sent: perhaps empty
  const std::string name = path != "/" ? path.substr(1) : of_one ? "index.html" : "all.html";
  const auto files = page_files();
  const auto file = std::find_if(files.begin(), files.end(), [&](const PageFile& f) { return f.name == name; });
  if (file == files.end()) return line(404, "there is no such page");
  const std::string content = page_folder_.empty() ? std::string(file->content) : contents(page_folder_ / file->name);
  return {.type = type_of(name), .body = std::make_shared<const std::string>(content)};
}

}  // namespace bolo::view
