// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdlib>
#include <regista/xdr/framer.hpp>

using namespace regista;

namespace {

/// The search goes on until one of these aborts.
void require(bool condition) {
  if (!condition) std::abort();
}

constexpr std::size_t max_body = 4096;

struct Outcome {
  std::vector<std::byte> messages;  ///< re-encoded headers and bodies
  std::string error;
};

/// Feeds the stream in chunks of the lengths given, again and again; 0 stands for as much as fits.
Outcome cut(std::span<const std::byte> stream, std::span<const std::byte> lengths) {
  xdr::Framer framer{max_body};
  Outcome outcome;
  for (std::size_t chunk = 0; !stream.empty(); ++chunk) {
    const auto space = framer.space();
    require(!space.empty());
    const auto wanted = std::to_integer<std::size_t>(lengths[chunk % lengths.size()]);
    const std::size_t size = std::min({wanted == 0 ? stream.size() : wanted, space.size(), stream.size()});
    std::ranges::copy(stream.first(size), space.begin());
    framer.commit(size);
    stream = stream.subspan(size);
    for (;;) {
      const auto frame = framer.next();
      if (!frame) {
        require(frame.error().code == xdr::Errc::oversize);
        outcome.error = frame.error().what;
        return outcome;
      }
      if (!*frame) break;
      const auto& [header, body] = **frame;
      require(body.size() == header.size && body.size() <= max_body);
      const std::size_t at = outcome.messages.size();
      outcome.messages.resize(at + xdr::header_size);
      xdr::encode_message(header, Empty{}, std::span{outcome.messages}.subspan(at));
      outcome.messages.insert(outcome.messages.end(), body.begin(), body.end());
    }
  }
  return outcome;
}

}  // namespace

/// The first eight bytes are lengths of chunks, the rest is a stream: however it is cut, the same messages come out,
/// and the same error at the same byte.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t lengths = 8;
  if (size < lengths) return 0;
  const auto input = std::as_bytes(std::span{data, size});
  const auto stream = input.subspan(lengths);
  const Outcome cut_so = cut(stream, input.first(lengths));
  constexpr std::array at_once{std::byte{0}};
  const Outcome whole = cut(stream, at_once);
  require(cut_so.messages == whole.messages);
  require(cut_so.error == whole.error);
  return 0;
}
