// The files beside a ".part": the input is written as its journal and live record, torn or with valid checksums.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "src/capture/capture.hpp"
#include "src/capture/commit_records.hpp"
#include "tests/fuzz/input.hpp"
#include "tests/fuzz/use_capture.hpp"

using namespace bolo;
using namespace bolo::capture;

namespace {

// An unfinished recording in a folder of this process.
class Rig {
 public:
  Rig() {
    std::string pattern = (std::filesystem::temp_directory_path() / "bolo_fuzz_XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr) std::abort();
    folder_ = pattern;
    CaptureInfo info;
    info.format.geometry = {4, 3};
    info.format.frame_period_s = 0.005;
    const std::vector<std::uint16_t> plane(info.format.geometry.pixels());
    auto writer = CaptureWriter::create(folder_ / "whole.h5", info);
    for (int i = 0; i < 3; ++i) {
      if (!writer->append(0.005 * i, static_cast<std::uint64_t>(i), plane.data())) std::abort();
    }
  }
  ~Rig() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  Rig(const Rig&) = delete;
  Rig& operator=(const Rig&) = delete;

  std::filesystem::path part() const { return folder_ / "a.h5.part"; }
  std::filesystem::path out() const { return folder_ / "out.h5"; }
  void lay_part() const {
    std::filesystem::copy_file(folder_ / "whole.h5.part", part(), std::filesystem::copy_options::overwrite_existing);
  }

 private:
  std::filesystem::path folder_;
};

void write_file(const std::filesystem::path& file, std::span<const std::uint8_t> bytes) {
  std::ofstream(file, std::ios::binary | std::ios::trunc)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

PageRecord take_record(fuzz::Input& input) {
  PageRecord record;
  record.sequence = input.take<std::uint8_t>();
  for (std::size_t pages = input.take<std::uint8_t>() % 4; pages > 0; --pages) {
    const auto near = input.take<std::uint8_t>();
    const std::uint64_t number = near < 250 ? near % 8 : input.take<std::uint64_t>();
    Page page(kPageBytes);
    const auto bytes = input.take_bytes(input.take_up_to(kPageBytes));
    std::memcpy(page.data(), bytes.data(), bytes.size());
    record.pages.emplace(number, std::move(page));
  }
  return record;
}

void write_records(fuzz::Input& input, const std::filesystem::path& part) {
  remove_records(part);
  const auto how = input.take<std::uint8_t>();
  if ((how & 1U) != 0) {
    const std::vector<std::byte> bytes = to_bytes(take_record(input));
    write_file(journal_of(part), {reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
  } else {
    write_file(journal_of(part), input.take_bytes(input.take_up_to(2 * kPageBytes)));
  }
  if ((how & 2U) != 0) {
    if (auto live = LiveRecord::create(part)) {
      for (std::size_t records = how >> 6U; records > 0; --records) live->write(take_record(input));
    }
  } else if ((how & 4U) != 0) {
    write_file(live_of(part), input.take_bytes(input.take_up_to(2 * kPageBytes)));
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  static const Rig rig;
  fuzz::Input input(data, bytes);
  rig.lay_part();
  write_records(input, rig.part());
  if (const auto reader = CaptureReader::open(rig.part())) fuzz::use_capture(*reader);
  std::error_code ignored;
  static_cast<void>(recover_copy(rig.part(), rig.out(), {}));
  std::filesystem::remove(rig.out(), ignored);
  if (recover_in_place(rig.part(), rig.out()) && !CaptureReader::open(rig.out())) std::abort();
  std::filesystem::remove(rig.out(), ignored);
  return 0;
}
