// `bolo convert`: converts between captures, image files, raw dumps, radiometric stills and films.
#include <charconv>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <string_view>

#include "src/core/text.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"
#include "tools/convert/footage.hpp"

namespace bolo::tools {
namespace {

constexpr int kMostSide = 1 << 15;

struct ConvertRequest {
  Files in;
  std::optional<std::size_t> frame;  // only this frame
  Target out;
  std::string topic;
  StatedFormat stated;
  std::optional<RawLayout> raw;
};

cxxopts::Options convert_options() {
  cxxopts::Options options(
      "bolo convert",
      "Convert captures (.h5, .part, the authors' .mat), ROS 2 recordings (.mcap), CPTV films, PNG and TIFF\n"
      "pictures, FLIR radiometric JPEG stills and raw dumps to a capture (.h5), a ROS 2 recording (.mcap), PNG or\n"
      "TIFF pictures, or a film for viewing (.mp4).\n");
  options.positional_help("IN...").show_positional_help();
  add_option<std::vector<std::string>>(options, "in", "Files to convert, in order");
  add_option<std::string>(options, "o,output", "File to write; its extension sets the format");
  add_option<double>(options, "rate", "Frames per second of pictures and dumps", "30");
  add_option<double>(options, "scale", "Kelvin per count of integer pictures and dumps, or of the PNG to write (0.01)");
  add_option<double>(options, "offset", "Kelvin at count 0 of these");
  add_option<std::string>(options, "raw", "WxH[:u16le|u16be|f32]: format of raw frames in the input files");
  add_option<std::size_t>(options, "frame", "Only this frame, counted from 0", nullptr, "N");
  add_option<std::uint64_t>(options, "skip", "Bytes before the first raw frame", "0");
  add_option<std::string>(
      options, "name", "MCAP to write: the camera's name, as in /NAME/image_raw and /NAME/image_deblurred", "thermal");
  add_option<std::string>(options, "topic", "MCAP input: topic of the images, if there are several");
  add_option<bool>(options, "preview", "PNG: 8 bits for viewing instead of 16 linear bits");
  add_option<std::vector<double>>(
      options, "range", "Black and white of --preview and films, K (counts without kelvin); default: follows the scene",
      nullptr, "LOW,HIGH");
  add_overwrite_option(options);
  options.parse_positional({"in"});
  return options;
}

Result<RawLayout> parse_raw(const std::string& text) {
  RawLayout layout;
  const std::size_t colon = text.find(':');
  const std::string_view size = std::string_view(text).substr(0, colon);
  const std::string type = colon == std::string::npos ? "u16le" : text.substr(colon + 1);
  const char* end = size.data() + size.size();
  const auto [x, no_width] = std::from_chars(size.data(), end, layout.geometry.width);
  const bool has_x = no_width == std::errc() && x != end && *x == 'x';
  const auto [rest, no_height] = std::from_chars(has_x ? x + 1 : end, end, layout.geometry.height);
  const auto side = [](int v) { return v >= 1 && v <= kMostSide; };
  if (!has_x || no_height != std::errc() || rest != end || !side(layout.geometry.width) ||
      !side(layout.geometry.height)) {
    return bad_input("--raw '" + text + "' is not WIDTHxHEIGHT[:u16le|u16be|f32], for example 640x120:u16be");
  }
  if (type != "u16le" && type != "u16be" && type != "f32") {
    return bad_input("--raw: '" + type + "' is none of u16le, u16be, f32");
  }
  if (type == "f32") layout.type = PixelType::kFloat32;
  layout.big_endian = type == "u16be";
  return layout;
}

// Checks for a valid ROS name: letters, digits and '_' between slashes, starting with a letter.
Status check_name(const std::string& name) {
  bool begins = true;
  for (const char c : name) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
    const bool good = letter || (!begins && (c == '_' || c == '/' || (c >= '0' && c <= '9')));
    if (!good) return bad_input("--name '" + name + "' is no name for ROS: letters, digits, _ and / after a letter");
    begins = c == '/';
  }
  return begins ? bad_input("--name must not be empty or end in /") : Status{};
}

Status read_scale(const cxxopts::ParseResult& parsed, ConvertRequest& request) {
  if (parsed.count("scale") == 0 && parsed.count("offset") == 0) return {};
  LinearScale scale{Unit::kKelvin, 1.0, 0.0};
  if (parsed.count("scale") != 0) scale.scale = parsed["scale"].as<double>();
  if (parsed.count("offset") != 0) scale.offset = parsed["offset"].as<double>();
  if (!std::isfinite(scale.scale) || scale.scale == 0.0 || !std::isfinite(scale.offset)) {
    return bad_input("--scale must be a number other than 0, --offset a number");
  }
  request.stated.scale = scale;
  request.out.picture_scale = scale;
  return {};
}

Status read_range(const cxxopts::ParseResult& parsed, Target& out) {
  if (parsed.count("range") == 0) return {};
  const auto range = parsed["range"].as<std::vector<double>>();
  if (range.size() != 2 || !std::isfinite(range[0]) || !std::isfinite(range[1]) || range[0] >= range[1])
    return bad_input("--range must be LOW,HIGH, LOW below HIGH, for example 285,315");
  if (!out.preview && out.file.path.extension() != ".mp4")
    return bad_input("--range is of pictures for the eye: add --preview, or write a film (.mp4)");
  out.range = {range[0], range[1]};
  return {};
}

bool is_capture(const std::filesystem::path& file) {
  const std::string extension = file.extension().string();
  return extension == ".h5" || extension == ".mat" || extension == ".part" || extension == ".hdf5";
}

// Refuses options without effect: the user would expect other values.
Status check_followed(const cxxopts::ParseResult& parsed, const ConvertRequest& request) {
  const auto given = [&](const char* name) { return parsed.count(name) != 0; };
  const std::filesystem::path& in = request.in.front();
  const bool capture = !request.raw && is_capture(in);
  if (given("skip") && !request.raw) return bad_input("--skip is of raw frames: add --raw WxH");
  if (given("topic") && in.extension() != ".mcap") return bad_input("--topic is of MCAP recordings");
  if (capture && given("rate"))
    return bad_input("--rate is of pictures and dumps; a capture has its own: " + in.string());
  if (capture && (given("scale") || given("offset")) && request.out.file.path.extension() != ".png")
    return bad_input("--scale and --offset are of pictures and dumps; a capture has its own: " + in.string());
  return {};
}

Result<ConvertRequest> convert_request(const cxxopts::ParseResult& parsed) {
  if (parsed.count("in") == 0) return bad_input("which files? usage: bolo convert IN... -o OUT");
  if (parsed.count("output") == 0) return bad_input("where to? usage: bolo convert IN... -o OUT");
  ConvertRequest request;
  request.in = files_of(parsed, "in");
  request.out.file = {parsed["output"].as<std::string>(), replace_of(parsed)};
  request.out.inputs = request.in;
  request.out.preview = parsed.count("preview") != 0;
  RETURN_IF_ERROR(read_range(parsed, request.out));
  if (parsed.count("frame") != 0) request.frame = parsed["frame"].as<std::size_t>();
  request.out.name = parsed["name"].as<std::string>();
  RETURN_IF_ERROR(check_name(request.out.name));
  if (parsed.count("topic") != 0) request.topic = parsed["topic"].as<std::string>();
  request.stated.rate_hz = parsed["rate"].as<double>();
  if (!(request.stated.rate_hz >= 1e-6 && request.stated.rate_hz <= 1e6))  // limits of the capture format
    return bad_input("--rate must be 0.000001 to 1000000 frames a second");
  RETURN_IF_ERROR(read_scale(parsed, request));
  if (parsed.count("raw") != 0) {
    ASSIGN_OR_RETURN(RawLayout layout, parse_raw(parsed["raw"].as<std::string>()));
    layout.skip_bytes = parsed["skip"].as<std::uint64_t>();
    request.raw = layout;
  }
  RETURN_IF_ERROR(check_followed(parsed, request));
  // Outputs of an image series are checked when their number is known.
  if (request.out.file.path.extension() == ".png") return request;
  RETURN_IF_ERROR(check_outputs({request.out.file.path}, request.in, request.out.file.replace));
  return request;
}

Result<std::unique_ptr<Footage>> open_footage(const ConvertRequest& request) {
  if (request.raw) return open_raw(request.in, *request.raw, request.stated);
  const std::filesystem::path& first = request.in.front();
  const bool film = first.extension() == ".cptv";
  const bool recording = first.extension() == ".mcap";
  if (!film && !recording && !is_capture(first)) return open_pictures(request.in, request.stated);
  const bool merges = !film && !recording && request.out.file.path.extension() == ".mcap";
  if (request.in.size() > 1 && !merges) {
    const std::string kind = film ? "film" : recording ? "recording" : "capture";
    return bad_input("one " + kind + " at a time; " + std::to_string(request.in.size()) + " files were given");
  }
  if (film) return open_cptv(first, request.stated);
  return recording ? open_mcap(first, request.topic, request.stated) : open_captures(request.in);
}

// One frame of other footage, as footage of its own.
class OneFrame final : public Footage {
 public:
  OneFrame(std::unique_ptr<Footage> from, std::size_t frame) : from_(std::move(from)), frame_(frame) {
    info_ = from_->info();
    info_.frames = 1;
  }
  Status read(std::size_t, Frame& frame) override { return from_->read(frame_, frame); }
  // Drops events, which belong to other times.
  Result<Extras> extras() const override {
    auto extras = from_->extras();
    if (extras) extras->events.clear();
    return extras;
  }

 private:
  std::unique_ptr<Footage> from_;
  std::size_t frame_;
};

Result<std::unique_ptr<Footage>> chosen_footage(const ConvertRequest& request) {
  auto footage = open_footage(request);
  if (!footage || !request.frame) return footage;
  if ((*footage)->parts().size() > 1) return bad_input("--frame is of one capture; several were given");
  const std::size_t frames = (*footage)->info().frames;
  if (*request.frame >= frames)
    return bad_input("--frame " + std::to_string(*request.frame) + ": there are frames 0 to " +
                     std::to_string(frames - 1));
  return std::make_unique<OneFrame>(std::move(*footage), *request.frame);
}

Status convert(Footage& footage, FootageSink& sink) {
  Progress progress("converting", footage.info().frames);
  Frame frame;
  for (std::size_t i = 0; i < footage.info().frames; ++i) {
    if (interrupted()) return failed("interrupted after " + std::to_string(i) + " frames");
    RETURN_IF_ERROR(footage.read(i, frame));
    RETURN_IF_ERROR(sink.write(frame));
    progress.update(i + 1);
  }
  return sink.finish();
}

Status run_convert(const cxxopts::ParseResult& given) {
  std::signal(SIGPIPE, SIG_IGN);  // the end of an encoder is an error, not a reason to end
  ASSIGN_OR_RETURN(const auto request, convert_request(given));
  // Films and recordings are unpacked completely first, perhaps for minutes: signals still end the process.
  ASSIGN_OR_RETURN(const auto footage, chosen_footage(request));
  catch_interrupts();
  ASSIGN_OR_RETURN(const auto sink, open_sink(request.out, *footage));
  RETURN_IF_ERROR(convert(*footage, *sink));
  const Geometry size = footage->info().format.geometry;
  const std::string files = sink->files();
  const std::string made = printable(files.empty() ? request.out.file.path.string() : files);
  const std::size_t frames = footage->info().frames;
  std::printf("%s: %zu frame%s of %dx%d\n", made.c_str(), frames, frames == 1 ? "" : "s", size.width, size.height);
  if (const std::string meaning = sink->meaning(); !meaning.empty()) std::printf("values: %s\n", meaning.c_str());
  return {};
}

}  // namespace

int convert_main(int argc, char** argv) {
  return run_verb("convert", convert_options(), argc, argv, run_convert, false);
}

}  // namespace bolo::tools
