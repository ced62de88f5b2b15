#ifndef ASTERISM_PLAYGROUND_H
#define ASTERISM_PLAYGROUND_H

/* The functions of the solver that the playground's page calls. A point is `dim` numbers, 2 or 3; nodes and
 * links are counted from 0. Nothing here throws; a solve's status and the message describe errors in a
 * system. */

#ifdef __cplusplus
extern "C" {
#endif

typedef struct asterism_playground asterism_playground;

/* A system of `nodes` nodes and `links` links, whose ends are 2 * links indices. All values are 0. */
asterism_playground* asterism_playground_new(int dim, int nodes, int links, const int* ends);
void asterism_playground_delete(asterism_playground* p);

/* Arrays, and their numbers of values. The caller writes the first five and the last; the others are valid
 * until the next call.
 * - 0 anchors, 1 anchor_stiffness, 2 rest_length, 3 link_stiffness
 * - 4 x: the start, then the result
 * - 5 of each iteration: number, energy, norm of the gradient
 * - 6 of each iteration, of a long solve only the first ones: x
 * - 7 summary: status, iterations, energy evaluations, gradient evaluations, linear solves, factorizations,
 *   initial energy, final energy, lower bound, norm of the gradient, stationarity, positive definite, seconds
 * - 8 certificate: proof, energy, lower bound, least eigenvalue, distance
 * - 9 covariances, a dim x dim block per node; none if they could not be computed
 * - 10 energies of the landscape, row by row
 * - 11 the landscape's grid: its first point, the step to the next column, that to the next row */
double* asterism_playground_array(asterism_playground* p, int which);
int asterism_playground_count(asterism_playground* p, int which);

/* A fixed node stays at its position in x. */
void asterism_playground_fix(asterism_playground* p, int node, int is_fixed);

/* Moves x to a stationary point; returns asterism::Status. Methods: asterism_playground_method. */
int asterism_playground_solve(asterism_playground* p, int method, double tolerance, int max_iterations);
/* Certifies x; returns asterism::Proof. The message says why no more is proven. */
int asterism_playground_certify(asterism_playground* p);
/* The nodes' covariances at x; returns whether there are any. The message says why there are none. */
int asterism_playground_covariances(asterism_playground* p);
/* E(x). */
double asterism_playground_energy(const asterism_playground* p);
/* E with `node` at each point of the grid, the other nodes at x. */
void asterism_playground_landscape(asterism_playground* p, int node, int columns, int rows);

/* The message of the last solve, certificate or covariances. */
const char* asterism_playground_message(const asterism_playground* p);
/* The full name of the last solve's method. */
const char* asterism_playground_solver(const asterism_playground* p);

/* The name of a method for asterism::solve, NULL beyond the last one. */
const char* asterism_playground_method(int index);
const char* asterism_playground_status(int status);
const char* asterism_playground_proof(int proof);

#ifdef __cplusplus
}
#endif

#endif
