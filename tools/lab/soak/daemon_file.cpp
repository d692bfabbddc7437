#include "tools/lab/soak/daemon_file.hpp"

#include <fstream>
#include <optional>

#include <toml++/toml.h>

namespace bolo::tools::soak {
namespace {

// As many frames as a reader needs that does not get a processor for a second.
constexpr int kRingFrames = 256;

Result<toml::table> parse(const std::filesystem::path& file) {
  try {
    return toml::parse_file(file.string());
  } catch (const toml::parse_error& error) {
    return bad_input(file.string() + ":" + std::to_string(error.source().begin.line) + ": " +
                     std::string(error.description()));
  }
}

toml::table& section(toml::table& table, std::string_view key) {
  if (table.get_as<toml::table>(key) == nullptr) table.insert_or_assign(key, toml::table{});
  return *table.get_as<toml::table>(key);
}

Status save(const std::filesystem::path& file, const toml::table& table) {
  std::ofstream out(file);
  out << table << '\n';
  return out.good() ? Status{} : failed("cannot write " + file.string());
}

// The base's profile, whose camera drops the frames that a shutter repeats.
Status write_profile(const DaemonFile& file, const std::optional<std::string>& base) {
  toml::table profile;
  if (base) {
    const std::filesystem::path from = file.base.parent_path() / *base;
    auto parsed = parse(from);
    if (!parsed) return tl::unexpected<Error>(parsed.error());
    profile = std::move(*parsed);
    if (const auto maps = profile["maps"].value<std::string>()) {
      profile.insert_or_assign("maps", std::filesystem::absolute(from.parent_path() / *maps).string());
    }
  }
  section(profile, "firmware").insert_or_assign("drop_repeated", true);
  return save(file.folder / "profile.toml", profile);
}

}  // namespace

std::filesystem::path config_of(const DaemonFile& file) { return file.folder / "bolod.toml"; }

Status write_daemon_file(const DaemonFile& file) {
  toml::table table;
  if (!file.base.empty()) {
    auto parsed = parse(file.base);
    if (!parsed) return tl::unexpected<Error>(parsed.error());
    table = std::move(*parsed);
  }
  if (Status written = write_profile(file, table["profile"].value<std::string>()); !written) return written;
  table.insert_or_assign("name", file.name);
  table.insert_or_assign("profile", (file.folder / "profile.toml").string());
  toml::table& source = section(table, "source");
  source.insert_or_assign("type", "genicam");
  source.insert_or_assign("address", file.address);
  source.insert_or_assign("serial", "");
  source.insert_or_assign("width", file.geometry.width);
  source.insert_or_assign("height", file.geometry.height);
  source.insert_or_assign("rate_hz", file.rate_hz);
  source.insert_or_assign("ir_format", "10mk");
  source.insert_or_assign("packet_size", file.packet_size);
  source.insert_or_assign("resend", true);
  // Planes are compared bit for bit; what lambda = "auto" measures goes on from before each fault.
  section(table, "deblur").insert("lambda", 0.001);
  section(table, "nuc").insert_or_assign("policy", "camera");
  section(table, "nuc").insert_or_assign("interval_s", file.nuc_interval_s);
  section(table, "shm").insert_or_assign("slots", kRingFrames);
  section(table, "control").insert_or_assign("socket", (file.folder / "control").string());
  for (const char* video : {"v4l2", "v4l2_second"}) table.erase(video);
  table.erase("metrics");
  section(table, "log").insert_or_assign("level", "info");
  section(table, "log").insert_or_assign("format", "text");
  return save(config_of(file), table);
}

}  // namespace bolo::tools::soak
