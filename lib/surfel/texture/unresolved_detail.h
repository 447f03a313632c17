#pragma once

#include <cstddef>

#include <surfel/base/export.h>
#include <surfel/texture/render_system.h>

namespace surfel {

/// For every function, the share of the texture's variance around it that the coefficients `w` do
/// not reproduce: a ratio of mean squares over the points of the functions that the far basis
/// reaches, averaged with the far basis' weights twice over. The share is 1 where detail is finer
/// than the functions can hold, and some tenths at a sharp edge that they can hold; it is 0 where
/// the texture is constant, and where no point is reached.
/// \param system  with a far basis (mu > 0).
/// \param f  per near point.
SURFEL_API Array<double> unresolved_share(const RenderSystem& system, const Array<Channels>& w,
                                          const Array<Channels>& f);

/// Raises lambda where the texture has detail that the functions cannot hold (RenderSystem::held).
/// Coefficients fitted to such detail are aliased: no gain from near, and noise from afar, where
/// w_0, which averages it away, is right. Little happens up to a share of 0.4; from 0.5 on, lambda
/// is larger by 10 times the mean diagonal of the normal matrix.
/// \param w  the solution without.
/// \return the number of functions whose lambda was raised.
SURFEL_API std::size_t hold_unresolved(RenderSystem& system, const Array<Channels>& w,
                                       const Array<Channels>& f);

}  // namespace surfel
