#include "tools/deblur/made_from.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <zlib.h>

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <system_error>
#include <variant>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/frame.hpp"
#include "src/core/input_file.hpp"
#include "src/core/unique_fd.hpp"
#include "src/deblur/isa.hpp"
#include "tools/deblur/pixel_choice.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::streamsize kPieceBytes = 1 << 16;

class Checksum {
 public:
  void add(const void* data, std::size_t bytes) {
    value_ = crc32_z(value_, static_cast<const unsigned char*>(data), bytes);
  }
  template <typename T>
  void add(const std::vector<T>& values) {
    add(values.data(), values.size() * sizeof(T));
  }
  std::uint64_t value() const { return value_; }

 private:
  uLong value_ = crc32_z(0, nullptr, 0);
};

// Contains the instruction set only if the user chose it: hosts of several kinds may share a folder.
json settings_of(const DeblurRequest& request) {
  const deblur::Settings& s = request.options.deblur;
  json settings{{"solver", deblur::name(s.method)},
                {"tau_s", s.tau_s},
                {"window", s.window},
                {"levels", s.levels},
                {"kappa", s.kappa},
                {"lambda", s.auto_lambda ? json("auto") : json(s.lambda)},
                {"noise_k", s.noise_k},
                {"iterations", s.iterations},
                {"lookahead", s.lookahead},
                {"type", request.options.output == PixelType::kUint16 ? "uint16" : "float32"}};
  if (request.isa_given) settings["isa"] = deblur::best_isa();
  if (request.options.undo.scene_nuc) settings["scene_nuc"] = true;
  if (request.options.region) settings["roi"] = describe_region(*request.options.region);
  return settings;
}

Result<std::uint64_t> checksum_of(const capture::CaptureReader& input) {
  Checksum sum;
  sum.add(input.t());
  sum.add(input.frame_id());
  const StreamFormat& format = input.info().format;
  std::vector<std::byte> plane(plane_bytes(format.geometry, format.type));
  for (const std::size_t index : {std::size_t{0}, input.info().frames - 1}) {
    RETURN_IF_ERROR(input.read_frame(index, plane.data()));
    sum.add(plane);
  }
  return sum.value();
}

}  // namespace

Result<std::uint64_t> checksum_of_file(const fs::path& file) {
  ASSIGN_OR_RETURN(std::ifstream in, stream_input(file));
  Checksum sum;
  for (std::vector<char> piece(kPieceBytes); in;) {
    in.read(piece.data(), kPieceBytes);
    sum.add(piece.data(), static_cast<std::size_t>(in.gcount()));
  }
  if (in.bad()) return bad_input(file.string() + ": cannot be read");
  return sum.value();
}

Result<std::string> made_from(const DeblurRequest& request, const capture::CaptureReader& input) {
  json all{{"settings", settings_of(request)}, {"frames", input.info().frames}};
  ASSIGN_OR_RETURN(const auto sum, checksum_of(input));
  all["input"] = sum;
  for (const auto& [name, of_file] : request.sums) all[name] = of_file;
  if (!request.points_file.empty()) {  // the file is read again for each capture
    ASSIGN_OR_RETURN(const auto points, checksum_of_file(request.points_file));
    all["points"] = points;
  }
  return all.dump();
}

bool is_made(const fs::path& output, const fs::path& input, const std::string& made_from) {
  std::error_code error;
  const auto made = fs::last_write_time(output, error);
  if (error || fs::last_write_time(input, error) > made || error) return false;
  const auto reader = capture::CaptureReader::open(output);
  if (!reader || !reader->warnings().empty()) return false;
  const auto attributes = reader->attributes();
  return attributes && std::ranges::any_of(*attributes, [&](const capture::Attribute& attribute) {
           const auto* text = std::get_if<std::string>(&attribute.value);
           return attribute.name == kMadeFrom && text != nullptr && *text == made_from;
         });
}

// Recordings have this attribute from the first commit on, outputs of this verb do not.
bool is_unfinished_recording(const fs::path& output) {
  const auto reader = capture::CaptureReader::open(output.string() + ".part");
  if (!reader) return false;
  const auto attributes = reader->attributes();
  return attributes && std::ranges::any_of(*attributes, [](const auto& one) { return one.name == "recorded_at"; });
}

bool is_being_made(const fs::path& output) {
  const UniqueFd part(::open((output.string() + ".part").c_str(), O_RDWR | O_CLOEXEC));
  return part && ::flock(part.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

}  // namespace bolo::tools
