#include "tools/view/site.hpp"

#include <algorithm>
#include <array>
#include <cctype>

#include <fmt/format.h>
#include <strings.h>
#include <sys/random.h>
#include <sys/stat.h>

#include "src/core/input_file.hpp"
#include "src/core/ip_address.hpp"
#include "src/core/text.hpp"

namespace bolo::view {
namespace {

constexpr std::size_t kShortestToken = 16;
constexpr std::size_t kLongestToken = 128;
constexpr std::uint64_t kLargestTokenFile = 4096;

std::string cookie_name(const Access& access) { return "bolo_view_" + std::to_string(access.port); }

// Constant-time comparison for equal lengths, so that timing does not reveal a token.
bool same(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned differ = 0;
  for (std::size_t i = 0; i < a.size(); ++i) differ |= static_cast<unsigned>(a[i] ^ b[i]);
  return differ == 0;
}

// "name:8640" -> "name", "[::1]:8640" -> "::1"
std::string without_port(const std::string& host) {
  if (host.starts_with('[')) return host.substr(1, host.find(']') - 1);
  return host.substr(0, host.find(':'));
}

bool equal_names(const std::string& a, const std::string& b) { return strcasecmp(a.c_str(), b.c_str()) == 0; }

bool has_token(const Access& access, const Request& request) {
  if (access.token.empty()) return false;
  return same(request.cookie(cookie_name(access).c_str()).value_or(""), access.token) ||
         same(request.argument("token").value_or(""), access.token);
}

// Current browsers state the origin of a request; older ones cannot read the answer across origins.
bool from_another_site(const Request& request) {
  const std::string site = request.header("Sec-Fetch-Site").value_or("none");
  return site == "cross-site" || site == "same-site";
}

constexpr std::chrono::milliseconds kFramePatience{2000};

// A whole number; nothing if missing or malformed.
template <typename Number>
std::optional<Number> number(const Request& request, const char* name) {
  const auto text = request.argument(name);
  return text ? whole_number<Number>(*text) : std::nullopt;
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

// Texts in shared memory may be cut within a character.
Answer json_answer(const nlohmann::ordered_json& json) {
  return {.type = "application/json",
          .body = std::make_shared<const std::string>(
              json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace))};
}

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

Answer status(LiveStream& stream, const NucTrigger& nuc) {
  nlohmann::ordered_json json = stream.status();
  json["view"]["nuc_asking"] = nuc.pending();
  json["view"]["nuc_trouble"] = nuc.trouble();
  return json_answer(json);
}

Answer nuc(NucTrigger& asker) {
  return asker.start() ? line(202, "the camera is asked") : line(409, "a NUC is being asked for already");
}

}  // namespace

Status check_token(const std::string& token) {
  const bool clean = std::all_of(token.begin(), token.end(),
                                 [](unsigned char c) { return std::isalnum(c) != 0 || c == '-' || c == '_'; });
  if (clean && token.size() >= kShortestToken && token.size() <= kLongestToken) return {};
  return bad_input("the token must have 16 to 128 letters, digits, '-' or '_'; make one: openssl rand -hex 16");
}

Result<std::string> random_token() {
  std::array<unsigned char, 16> bytes{};
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    return failed("the system has no random numbers: give --token-file FILE");
  }
  return fmt::format("{:02x}", fmt::join(bytes, ""));
}

Result<std::string> read_token(const std::string& file) {
  struct stat about {};
  ASSIGN_OR_RETURN(const std::string whole, read_input(file, kLargestTokenFile));
  if (stat(file.c_str(), &about) != 0) return bad_input("cannot read the token file " + file);
  if ((about.st_mode & 077) != 0) return bad_input("others may read the token file: chmod 600 " + file);
  const std::string token = whole.substr(0, whole.find('\n'));
  if (const Status good = check_token(token); !good) return at(file, good.error());
  return token;
}

bool is_this_computer(const Access& access, const std::string& host) {
  const std::string name = without_port(host);
  const auto address = ip_address(name);
  if (equal_names(name, "localhost") || (address && address->loopback)) return true;
  if (!access.beyond_loopback) return false;
  // DNS rebinding needs a foreign host name, which neither an address nor this computer's own name is.
  return address || equal_names(name, access.host_name) || equal_names(name, access.host_name + ".local");
}

std::optional<Answer> refusal(const Access& access, const Request& request) {
  const auto host = request.header("Host");
  if (!host) return line(400, "the Host header is missing");
  if (!is_this_computer(access, *host)) return line(403, "this address does not belong to the view: use localhost");
  if (!has_token(access, request)) {
    return line(401, "a token is needed: open the address that bolo view printed, or with the ?token= it was given");
  }
  const bool page = request.path() == "/";  // may be opened by a link
  if (!page && from_another_site(request)) return line(403, "only the view's own page may ask for this");
  if (request.method() == "POST" && request.header("Origin").value_or("") != "http://" + *host) {
    return line(403, "only the view's own page may do this");
  }
  return std::nullopt;
}

std::optional<std::string> cookie_for(const Access& access, const Request& request) {
  if (!request.argument("token")) return std::nullopt;
  return cookie_name(access) + "=" + access.token + "; Path=/; HttpOnly; SameSite=Strict; Max-Age=604800";
}

Site::Site(Access access, const std::vector<LiveStream*>& streams, const Ask& ask_for_nuc,
           std::filesystem::path page_folder)
    : access_(std::move(access)), page_folder_(std::move(page_folder)) {
  for (LiveStream* stream : streams) {
    const auto ask = [ask_for_nuc, name = stream->name()] { return ask_for_nuc(name); };
    cameras_.push_back({*stream, std::make_unique<NucTrigger>(ask)});
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

// Removes "/camera/NAME" from the path. Null, with the path unchanged: no camera or an unknown one is named.
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
  if (!path.starts_with('/')) return line(404, "there is no such page");  // paths are as sent, perhaps empty
  const std::string name = path != "/" ? path.substr(1) : of_one ? "index.html" : "all.html";
  const auto files = page_files();
  const auto file = std::find_if(files.begin(), files.end(), [&](const PageFile& f) { return f.name == name; });
  if (file == files.end()) return line(404, "there is no such page");
  const std::string content =
      page_folder_.empty() ? std::string(file->content) : read_input(page_folder_ / file->name).value_or("");
  return {.type = type_of(name), .body = std::make_shared<const std::string>(content)};
}

}  // namespace bolo::view
