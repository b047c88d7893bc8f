/* Products of second derivatives of energy densities, known at integration points, with a change of the unknowns.

   Tetrahedra, straight or curved, with quadratic displacements and, if mixed, a linear p. LANES of them are worked on side by
   side: what belongs to one of them is the last index of every array. At a point the unknowns enter by a few numbers,
   e = B x: the nine derivatives of the displacement's components, then the components themselves or p where the density has
   them. The density's second derivative D by these, its upper triangle by rows, makes the product B^T D B x. */

#include <stdint.h>
#include <string.h>

#define LANES 8
#define NODES 10
#define CORNERS 4

typedef double lanes __attribute__((vector_size(8 * LANES)));
/* The same in arrays that begin anywhere. */
typedef double stored __attribute__((vector_size(8 * LANES), aligned(8), may_alias));

/* Second derivatives as they were computed, by cells or faces, to what the products read, with the weights of integration.
   What fills up the last LANES has no weight. */
void moduli_take(int64_t count, int64_t points, int64_t entries, const double *values, const double *weights, double *moduli)
{
    for (int64_t first = 0; first < count; first += LANES)
        for (int64_t q = 0; q < points; q++, moduli += entries * LANES)
            for (int l = 0; l < LANES; l++) {
                if (first + l >= count) {
                    for (int64_t k = 0; k < entries; k++)
                        moduli[k * LANES + l] = 0.0;
                    continue;
                }
                const int64_t at = (first + l) * points + q;
                for (int64_t k = 0; k < entries; k++)
                    moduli[k * LANES + l] = weights[at] * values[at * entries + k];
            }
}

/* Adds a product to y.
   dofs: unknowns of the nodes, then of p's corners, (batches, 30 [+ 4], LANES)
   inverse: derivative of the reference's coordinates by the place, (batches, points or 1, 3, 3, LANES)
   curved: whether there is one for each point
   shapes, slopes: shape functions and their derivatives, (points, 10) and (points, 10, 3)
   linear: those of p, (points, 4) */
#define PRODUCT(NAME, EXTRA, VALUES, PRESSURE)                                                                          \
    void NAME(int64_t batches, int64_t points, int64_t curved, const int32_t *dofs, const double *inverse,              \
              const double *shapes, const double *slopes, const double *linear, const double *moduli, const double *x,  \
              double *y)                                                                                                \
    {                                                                                                                   \
        enum { STRAINS = 9 + (EXTRA), UNKNOWNS = 3 * NODES + (PRESSURE ? CORNERS : 0) };                                \
        const stored *D = (const stored *)moduli;                                                                       \
        for (int64_t b = 0; b < batches; b++) {                                                                         \
            const int32_t *own = dofs + b * UNKNOWNS * LANES;                                                           \
            const stored *K = (const stored *)(inverse + b * (curved ? points : 1) * 9 * LANES);                        \
            lanes u[UNKNOWNS], r[UNKNOWNS];                                                                             \
            memset(r, 0, sizeof r);                                                                                     \
            for (int k = 0; k < UNKNOWNS; k++)                                                                          \
                for (int l = 0; l < LANES; l++)                                                                         \
                    u[k][l] = x[own[k * LANES + l]];                                                                    \
            for (int64_t q = 0; q < points; q++) {                                                                      \
                const double *N = shapes + q * NODES, *dN = slopes + 3 * q * NODES, *L = linear + q * CORNERS;          \
                if (curved && q > 0)                                                                                    \
                    K += 9;                                                                                             \
                lanes g[9], e[STRAINS], s[STRAINS];                                                                     \
                memset(g, 0, sizeof g);                                                                                 \
                memset(e, 0, sizeof e);                                                                                 \
                memset(s, 0, sizeof s);                                                                                 \
                for (int a = 0; a < NODES; a++)                                                                         \
                    for (int i = 0; i < 3; i++)                                                                         \
                        for (int j = 0; j < 3; j++)                                                                     \
                            g[3 * i + j] += dN[3 * a + j] * u[3 * a + i];                                               \
                for (int i = 0; i < 3; i++)                                                                             \
                    for (int k = 0; k < 3; k++)                                                                         \
                        for (int j = 0; j < 3; j++)                                                                     \
                            e[3 * i + k] += g[3 * i + j] * K[3 * j + k];                                                \
                if (VALUES)                                                                                             \
                    for (int a = 0; a < NODES; a++)                                                                     \
                        for (int i = 0; i < 3; i++)                                                                     \
                            e[9 + i] += N[a] * u[3 * a + i];                                                            \
                if (PRESSURE)                                                                                           \
                    for (int a = 0; a < CORNERS; a++)                                                                   \
                        e[STRAINS - 1] += L[a] * u[3 * NODES + a];                                                      \
                for (int i = 0; i < STRAINS; i++) {                                                                     \
                    s[i] += *D++ * e[i];                                                                                \
                    for (int j = i + 1; j < STRAINS; j++, D++) {                                                        \
                        s[i] += *D * e[j];                                                                              \
                        s[j] += *D * e[i];                                                                              \
                    }                                                                                                   \
                }                                                                                                       \
                memset(g, 0, sizeof g);                                                                                 \
                for (int i = 0; i < 3; i++)                                                                             \
                    for (int j = 0; j < 3; j++)                                                                         \
                        for (int k = 0; k < 3; k++)                                                                     \
                            g[3 * i + j] += s[3 * i + k] * K[3 * j + k];                                                \
                for (int a = 0; a < NODES; a++)                                                                         \
                    for (int i = 0; i < 3; i++)                                                                         \
                        for (int j = 0; j < 3; j++)                                                                     \
                            r[3 * a + i] += dN[3 * a + j] * g[3 * i + j];                                               \
                if (VALUES)                                                                                             \
                    for (int a = 0; a < NODES; a++)                                                                     \
                        for (int i = 0; i < 3; i++)                                                                     \
                            r[3 * a + i] += N[a] * s[9 + i];                                                            \
                if (PRESSURE)                                                                                           \
                    for (int a = 0; a < CORNERS; a++)                                                                   \
                        r[3 * NODES + a] += L[a] * s[STRAINS - 1];                                                      \
            }                                                                                                           \
            for (int k = 0; k < UNKNOWNS; k++)                                                                          \
                for (int l = 0; l < LANES; l++)                                                                         \
                    y[own[k * LANES + l]] += r[k][l];                                                                   \
        }                                                                                                               \
    }

PRODUCT(moduli_of_gradients, 0, 0, 0)
PRODUCT(moduli_with_pressure, 1, 0, 1)
PRODUCT(moduli_with_values, 3, 1, 0)
