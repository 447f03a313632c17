#pragma once

#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Calls visit(a's column, b's column) for every array of a cloud with a value per surfel, `extra`
/// excluded.
template <class A, class B, class Visit>
void visit_column_pairs(A& a, B& b, const Visit& visit) {
  visit(a.position, b.position);
  visit(a.exact, b.exact);
  visit(a.normal, b.normal);
  visit(a.shading_normal, b.shading_normal);
  visit(a.variance, b.variance);
  visit(a.tangent, b.tangent);
  visit(a.variance_u, b.variance_u);
  visit(a.variance_v, b.variance_v);
  visit(a.area, b.area);
  visit(a.clip1, b.clip1);
  visit(a.clip1_distance, b.clip1_distance);
  visit(a.clip2, b.clip2);
  visit(a.clip2_distance, b.clip2_distance);
  visit(a.color, b.color);
  visit(a.alpha, b.alpha);
  visit(a.coefficient, b.coefficient);
  visit(a.uv, b.uv);
  visit(a.dpdu, b.dpdu);
  visit(a.dpdv, b.dpdv);
  visit(a.material, b.material);
  visit(a.group, b.group);
  visit(a.group_radius, b.group_radius);
  visit(a.source, b.source);
  visit(a.level, b.level);
}

}  // namespace surfel
