#include "tools/cluster/digest.hpp"

#include <fstream>
#include <memory>
#include <sstream>

#include <glib.h>

namespace bolo::tools::cluster {

std::string sha256(const std::string& text) {
  const std::unique_ptr<char, decltype(&g_free)> digest(
      g_compute_checksum_for_data(G_CHECKSUM_SHA256, reinterpret_cast<const unsigned char*>(text.data()), text.size()),
      &g_free);
  return digest.get();
}

Result<std::string> sha256_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream bytes;
  if (in) bytes << in.rdbuf();
  if (!in) return bad_input(file.string() + ": cannot be read");
  return sha256(bytes.str());
}

}  // namespace bolo::tools::cluster
