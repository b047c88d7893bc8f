/* Two levels of multigrid on displacements: the quadratic one's blocks and products, and the linear one's matrix.

   A node's d components stand side by side. Entries of the matrix are kept in single precision, which reads half the memory;
   vectors and sums are in double precision, so that all of it is a linear map to the last digits. */

#include <stdint.h>
#include <string.h>

/* Some rows of a matrix of PETSc, in the columns that are here or in those of other ranks. */
typedef struct {
    const int32_t *starts, *columns;
    const double *values;
    const int32_t *places; /* of each column among the local displacements, node by node; -1 if it is none of them */
} part;

/* Counts the nodes in each node's rows, and lists them if `columns` is given.
   rows: rows of the nodes' components
   left: whether such a row is left out, for which the identity stands
   seen: an entry for each local node, all -1 */
int64_t level_pattern(int64_t nodes, int d, const int32_t *rows, const int8_t *left, const part *parts, int32_t *seen,
                      int32_t *starts, int32_t *columns)
{
    int64_t count = 0;
    for (int64_t i = 0; i < nodes; i++) {
        starts[i] = (int32_t)count;
        for (int c = 0; c < d; c++) {
            if (left[d * i + c] && seen[i] != i) {
                seen[i] = (int32_t)i;
                if (columns)
                    columns[count] = (int32_t)i;
                count++;
            }
            for (int p = 0; p < 2 && !left[d * i + c]; p++)
                for (int32_t k = parts[p].starts[rows[d * i + c]]; k < parts[p].starts[rows[d * i + c] + 1]; k++) {
                    const int32_t place = parts[p].places[parts[p].columns[k]];
                    if (place < 0 || seen[place / d] == i)
                        continue;
                    seen[place / d] = (int32_t)i;
                    if (columns)
                        columns[count] = place / d;
                    count++;
                }
        }
    }
    starts[nodes] = (int32_t)count;
    return count;
}

/* Takes the entries: blocks by columns, and the diagonal's once more by rows.
   slots: an entry for each local node */
void level_take(int64_t nodes, int d, const int32_t *rows, const int8_t *left, const part *parts, const int32_t *starts,
                const int32_t *columns, int32_t *slots, float *values, double *diagonal)
{
    const int64_t size = d * d;
    for (int64_t i = 0; i < nodes; i++) {
        for (int32_t k = starts[i]; k < starts[i + 1]; k++)
            slots[columns[k]] = k;
        memset(values + size * starts[i], 0, sizeof(float) * size * (starts[i + 1] - starts[i]));
        memset(diagonal + size * i, 0, sizeof(double) * size);
        for (int c = 0; c < d; c++) {
            if (left[d * i + c])
                values[size * slots[i] + (d + 1) * c] = diagonal[size * i + (d + 1) * c] = 1.0;
            for (int p = 0; p < 2 && !left[d * i + c]; p++)
                for (int32_t k = parts[p].starts[rows[d * i + c]]; k < parts[p].starts[rows[d * i + c] + 1]; k++) {
                    const int32_t place = parts[p].places[parts[p].columns[k]];
                    if (place < 0)
                        continue;
                    values[size * slots[place / d] + d * (place % d) + c] = (float)parts[p].values[k];
                    if (place / d == i)
                        diagonal[size * i + d * c + place % d] = parts[p].values[k];
                }
        }
    }
}

/* Entries are read four at a time, of which the first D count: behind the last block there has to be room for it. */
typedef float four __attribute__((vector_size(16), aligned(4), may_alias));
typedef double wide __attribute__((vector_size(32)));
#define COLUMN(B) __builtin_convertvector(*(const four *)(B), wide)

/* level_residual: r = b - A x
   level_step: a step of Chebyshev's iteration, change = keep change + add D^-1 (b - A x), which is yet to be added to x;
   where nothing is kept, the change before it is not read */
#define LEVEL(D)                                                                                                        \
    static inline wide rest_##D(int32_t k, int32_t end, const int32_t *columns, const float *values, const double *b,   \
                                const double *x)                                                                        \
    {                                                                                                                   \
        wide sums[D];                                                                                                   \
        memset(sums, 0, sizeof sums);                                                                                   \
        for (int c = 0; c < D; c++)                                                                                     \
            sums[0][c] = b[c];                                                                                          \
        for (; k < end; k++) {                                                                                          \
            const float *B = values + D * D * (int64_t)k;                                                               \
            const double *at = x + D * (int64_t)columns[k];                                                             \
            for (int c = 0; c < D; c++)                                                                                 \
                sums[c] -= COLUMN(B + D * c) * at[c];                                                                   \
        }                                                                                                               \
        for (int c = 1; c < D; c++)                                                                                     \
            sums[0] += sums[c];                                                                                         \
        return sums[0];                                                                                                 \
    }                                                                                                                   \
    void level_residual_##D(int64_t nodes, const int32_t *starts, const int32_t *columns, const float *values,          \
                            const double *b, const double *x, double *r)                                                \
    {                                                                                                                   \
        for (int64_t i = 0; i < nodes; i++) {                                                                           \
            const wide rest = rest_##D(starts[i], starts[i + 1], columns, values, b + D * i, x);                        \
            for (int c = 0; c < D; c++)                                                                                 \
                r[D * i + c] = rest[c];                                                                                 \
        }                                                                                                               \
    }                                                                                                                   \
    void level_step_##D(int64_t nodes, const int32_t *starts, const int32_t *columns, const float *values,              \
                        const double *b, const double *x, const double *inverse, double keep, double add,               \
                        double *change)                                                                                 \
    {                                                                                                                   \
        for (int64_t i = 0; i < nodes; i++) {                                                                           \
            const wide rest = rest_##D(starts[i], starts[i + 1], columns, values, b + D * i, x);                        \
            for (int c = 0; c < D; c++) {                                                                               \
                double sum = 0.0;                                                                                       \
                for (int e = 0; e < D; e++)                                                                             \
                    sum += inverse[D * D * i + D * c + e] * rest[e];                                                    \
                change[D * i + c] = (keep == 0.0 ? 0.0 : keep * change[D * i + c]) + add * sum;                         \
            }                                                                                                           \
        }                                                                                                               \
    }

LEVEL(2)
LEVEL(3)

/* Adds to a linear level's vector what belongs to it of a quadratic one's.
   between: the two corners half way between which each node lies; a corner lies between itself */
void level_restrict(int64_t nodes, int d, const int32_t *between, const double *fine, double *linear)
{
    for (int64_t i = 0; i < 2 * nodes; i++)
        for (int c = 0; c < d; c++)
            linear[d * (int64_t)between[i] + c] += 0.5 * fine[d * (i / 2) + c];
}

/* The other way round. */
void level_prolong(int64_t nodes, int d, const int32_t *between, const double *linear, double *fine)
{
    for (int64_t i = 0; i < 2 * nodes; i++)
        for (int c = 0; c < d; c++)
            fine[d * (i / 2) + c] += 0.5 * linear[d * (int64_t)between[i] + c];
}

/* MatSetValuesBlocked. */
typedef int (*set_blocks)(void *, int32_t, const int32_t *, int32_t, const int32_t *, const double *, int);
#define ADD 2

/* Adds the linear level's matrix P^T A P to one of PETSc, what this rank's rows of A have of it; returns PETSc's error.
   starts, children: which nodes lie between each corner and another
   held: whether a row of A counts for nothing
   numbers: those of the corners in PETSc's matrix
   slots: an entry for each corner, all -1
   found, globals: room for as many; sums, entries: for d * d times as many */
int level_galerkin(int64_t corners, int d, const int32_t *starts, const int32_t *children, const int32_t *rows,
                   const int8_t *held, const part *parts, const int32_t *between, const int32_t *numbers, int32_t *slots,
                   int32_t *found, int32_t *globals, double *sums, double *entries, void *set, void *matrix)
{
    for (int64_t corner = 0; corner < corners; corner++) {
        int count = 0;
        for (int32_t child = starts[corner]; child < starts[corner + 1]; child++)
            for (int c = 0; c < d; c++) {
                const int64_t at = d * (int64_t)children[child] + c;
                for (int p = 0; p < 2 && !held[at]; p++)
                    for (int32_t k = parts[p].starts[rows[at]]; k < parts[p].starts[rows[at] + 1]; k++) {
                        const int32_t place = parts[p].places[parts[p].columns[k]];
                        for (int side = 0; side < 2 && place >= 0; side++) {
                            const int32_t other = between[2 * (int64_t)(place / d) + side];
                            if (slots[other] < 0) {
                                slots[other] = count;
                                found[count] = other;
                                memset(sums + d * d * (int64_t)count++, 0, sizeof(double) * d * d);
                            }
                            sums[d * (d * (int64_t)slots[other] + c) + place % d] += 0.25 * parts[p].values[k];
                        }
                    }
            }
        for (int k = 0; k < count; k++) {
            slots[found[k]] = -1;
            globals[k] = numbers[found[k]];
            for (int c = 0; c < d; c++)
                for (int e = 0; e < d; e++)
                    entries[d * ((int64_t)c * count + k) + e] = sums[d * (d * (int64_t)k + c) + e];
        }
        const int error = count ? ((set_blocks)set)(matrix, 1, numbers + corner, count, globals, entries, ADD) : 0;
        if (error)
            return error;
    }
    return 0;
}
