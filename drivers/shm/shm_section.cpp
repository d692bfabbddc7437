#include "drivers/shm/shm_section.hpp"

#include <utility>

namespace bolo::shm {

void ShmSection::declare(model::KeyTable& keys) {
  keys.section("shm", "frames for other programs: shared memory /bolo.NAME");
  keys.boolean("enable", enabled_, "Publish into shared memory.");
  keys.integer("slots", options_.slots, {0, 65536, "frames"},
               "Frames in the ring, at least window + lookahead; 0: 64, or more when the window needs more.");
  keys.octal("mode", options_.mode, {0600, 0777, ""},
             "Permission bits; readers need to read only: 0o640 for the group's members, 0o644 for everybody.");
  keys.text("group", options_.group,
            "Owner group, of which the daemon's user must be a member; empty: the daemon's own.");
}

Status ShmSection::check(const model::KeyTable& keys, const pipeline::SinkContext& context,
                         std::span<const std::shared_ptr<SinkSection>> /*before*/) const {
  if (const Status mode = check_mode(options_); enabled_ && !mode) {
    return bad_input(keys.where("shm.mode") + mode.error().message);
  }
  const int needed = context.deblur.window + context.deblur.lookahead;
  if (options_.slots == 0 || options_.slots >= needed) return {};
  return bad_input(keys.where("shm.slots") + "shm.slots = " + std::to_string(options_.slots) +
                   " is less than window + lookahead = " + std::to_string(needed) + "; give that or more, or 0");
}

std::string ShmSection::describe(const pipeline::SinkContext& context) const {
  return enabled_ ? "shared memory /bolo." + context.name : "";
}

std::uint64_t ShmSection::shared_bytes(const pipeline::SinkContext& context) const {
  return enabled_ ? bytes_needed(options_, context.deblur, context.frame) : 0;
}

std::unique_ptr<pipeline::FrameSink> ShmSection::make(const pipeline::SinkContext& context) const {
  if (!enabled_) return nullptr;
  ShmOptions options = options_;
  options.name = context.name;
  options.control_socket = context.control_socket;
  return std::make_unique<ShmSink>(std::move(options));
}

}  // namespace bolo::shm
