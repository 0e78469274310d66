"""Syntax errors as people see them: each source with its whole messages."""

import pytest
from maquette.lang import parse
from maquette.lang.diagnostics import Diagnostics, render_text

# A source, a line `-----`, its messages; `=====` between cases.
CASES = r'''
sphere(radius 1)
-----
t:1:15: error: `:` is missing after `radius`
   1 | sphere(radius 1)
     |               ^ write radius: 1
=====
sphere(1, 2
-----
t:1:7: error: this `(` is not closed
   1 | sphere(1, 2
     |       ^ write `)` where it ends
=====
sphere(center: [0, 1, 0, radius: 1)
-----
t:1:16: error: this `[` is not closed
   1 | sphere(center: [0, 1, 0, radius: 1)
     |                ^ write `]` before the `)`
=====
sphere(1))
-----
t:1:10: error: nothing is open that this `)` could close
   1 | sphere(1))
     |          ^ delete it
=====
sphere(1]
-----
t:1:9: error: nothing is open that this `]` could close
   1 | sphere(1]
     |         ^ delete it
=====
box(size: 1,, 2)
-----
t:1:13: error: a value is missing between the commas
   1 | box(size: 1,, 2)
     |             ^
=====
box(, 2)
-----
t:1:4: error: a value is missing after `(`
   1 | box(, 2)
     |    ^
=====
let = 3
-----
t:1:5: error: `let` wants a name
   1 | let = 3
     |     ^ write let size = 3
=====
let for = 3
-----
t:1:5: error: `for` is a word of the language and can't be a name
   1 | let for = 3
     |     ^^^ choose another name
=====
let x = for
-----
t:1:9: error: `for` is a word of the language, no value
   1 | let x = for
     |         ^^^
=====
let x
-----
t:1:5: error: `let x` has no value
   1 | let x
     |     ^ write let x = …
=====
let x 3
-----
t:1:7: error: `=` is missing after `let x`
   1 | let x 3
     |       ^ write let x = …
=====
let x =
-----
t:1:7: error: a value is missing after `=`
   1 | let x =
     |       ^
=====
let f(a, b) a + b
-----
t:1:13: error: `=` is missing before the value of `f`
   1 | let f(a, b) a + b
     |             ^ write let f(…) = …
=====
let f(a b) = a
-----
t:1:9: error: a `,` is missing before `b`
   1 | let f(a b) = a
     |         ^
=====
let f(a: 3) = a
-----
t:1:8: error: a default is written with `=`, not `:`
   1 | let f(a: 3) = a
     |        ^ write a = 3
=====
param teeth: 18
-----
t:1:14: error: a type is wanted behind the `:`
   1 | param teeth: 18
     |              ^^ write param teeth = … or param teeth: int = …
=====
param teeth: int 18
-----
t:1:18: error: `=` is missing before the value of `teeth`
   1 | param teeth: int 18
     |                  ^^ write param teeth: int = …
=====
param teeth: int: 18
-----
t:1:17: error: a `param` takes its value with `=`
   1 | param teeth: int: 18
     |                 ^ write param teeth = …
=====
param teeth
-----
t:1:7: error: `param teeth` has no value
   1 | param teeth
     |       ^^^^^ write param teeth = …
=====
param teeth = 18 in
-----
t:1:18: error: a value is missing after `in`
   1 | param teeth = 18 in
     |                  ^^
=====
param teeth = 18 in 6..60 teeth per gear
-----
t:1:27: error: what a `param` is for stands in quotes
   1 | param teeth = 18 in 6..60 teeth per gear
     |                           ^^^^^ write param teeth = … "what it is for"
=====
param teeth(a) = 3
-----
t:1:12: error: a `param` takes no parameters
   1 | param teeth(a) = 3
     |            ^ write let teeth(…) = …
=====
use room
-----
t:1:5: error: the file after `use` is written in quotes
   1 | use room
     |     ^^^^ write use "std/room" or use "room.scene"
=====
use
-----
t:1:1: error: `use` wants a file
   1 | use
     | ^^^ write use "std/room" or use "gear.scene"
=====
use "a.scene" as
-----
t:1:15: error: `as` wants a name
   1 | use "a.scene" as
     |               ^^ write use "robot.usdz" as robot
=====
use "a.scene" b
-----
t:1:15: error: `as` is missing before `b`
   1 | use "a.scene" b
     |               ^ write as b
=====
unit
-----
t:1:1: error: `unit` wants a unit of length
   1 | unit
     | ^^^^ write unit mm
=====
unit = mm
-----
t:1:6: error: `unit` wants a unit of length
   1 | unit = mm
     |      ^ write unit mm
=====
unit "mm"
-----
t:1:6: error: `unit` wants a unit of length
   1 | unit "mm"
     |      ^^^^ write unit mm
=====
if x > 3 { box() }
-----
t:1:4: error: `if` wants its condition in parentheses
   1 | if x > 3 { box() }
     |    ^ write if (…) { … }
=====
if (x > 3) box()
-----
t:1:12: error: `if` wants a block
   1 | if (x > 3) box()
     |            ^^^ write if (…) { … }
=====
if (x > 3)
-----
t:1:1: error: `if` wants a block
   1 | if (x > 3)
     | ^^ write if (…) { … }
=====
if (x > 3) { box() } else box()
-----
t:1:22: error: `else` wants a block or another `if`
   1 | if (x > 3) { box() } else box()
     |                      ^^^^ write else { … }
=====
else { box() }
-----
t:1:1: error: this `else` has no `if`
   1 | else { box() }
     | ^^^^ write if (…) { … } else { … }
=====
if (x = 3) { box() }
-----
t:1:7: error: `=` binds a name; values are compared with `==`
   1 | if (x = 3) { box() }
     |       ^ write `==`
=====
if (x > 3) then { box() }
-----
t:1:12: error: `if … then … else …` is a value, this `if` stands by itself
   1 | if (x > 3) then { box() }
     |            ^^^^ write if (…) { … }
=====
for k in 0..3 { box() }
-----
t:1:5: error: `for` wants its name and list in parentheses
   1 | for k in 0..3 { box() }
     |     ^ write for (k in 0..5) { … }
=====
for (k = 0..3) { box() }
-----
t:1:8: error: `for` wants `in` after its name
   1 | for (k = 0..3) { box() }
     |        ^ write for (k in 0..5) { … }
=====
for (0..3) { box() }
-----
t:1:6: error: `for` wants a name
   1 | for (0..3) { box() }
     |      ^ write for (k in 0..5) { … }
=====
for (k in 0..3) box()
-----
t:1:17: error: `for` wants a block
   1 | for (k in 0..3) box()
     |                 ^^^ write for (k in 0..5) { … }
=====
for (k in ) { box() }
-----
t:1:8: error: a value is missing after `in`
   1 | for (k in ) { box() }
     |        ^^
=====
let x = if a then b
-----
t:1:14: error: this `if` has no `else`
   1 | let x = if a then b
     |              ^^^^ write if … then … else …
=====
let x = if a b else c
-----
t:1:14: error: `then` is missing
   1 | let x = if a b else c
     |              ^ write if … then … else …
=====
let x = a < b < c
-----
t:1:15: error: comparisons can't be chained
   1 | let x = a < b < c
     |               ^ write a < b and b < c
=====
let x = 0..1..2
-----
t:1:13: error: a range has two ends
   1 | let x = 0..1..2
     |             ^^ write a..b
=====
let x = 1 +
-----
t:1:11: error: a value is missing after `+`
   1 | let x = 1 +
     |           ^
=====
let x = 1 + * 2
-----
t:1:13: error: a value is missing before `*`
   1 | let x = 1 + * 2
     |             ^
=====
let x = * 2
-----
t:1:9: error: a value is missing before `*`
   1 | let x = * 2
     |         ^
=====
let x = 2 ** 3
-----
t:1:11: error: the language has no `**`
   1 | let x = 2 ** 3
     |           ^ write `^`
=====
let x = a || b
-----
t:1:11: error: the language has no `||`
   1 | let x = a || b
     |           ^ write `or`
=====
let x = a && b
-----
t:1:11: error: the language has no `&`
   1 | let x = a && b
     |           ^ write `and`
=====
let x = !a
-----
t:1:9: error: the language has no `!`
   1 | let x = !a
     |         ^ write `not`
=====
let x = 5 % 3
-----
t:1:11: error: the language has no `%`
   1 | let x = 5 % 3
     |           ^ write mod(a, b) for a remainder; a percentage stands right behind its number: 50%
=====
let x = (1 + 2
let y = 3
-----
t:1:9: error: this `(` is not closed
   1 | let x = (1 + 2
     |         ^ write `)` where it ends
=====
let x = [1, 2, 3
box()
-----
t:1:9: error: this `[` is not closed
   1 | let x = [1, 2, 3
     |         ^ write `]` where it ends
=====
let x = [1 2 3]
-----
t:1:12: error: a `,` is missing before `2`
   1 | let x = [1 2 3]
     |            ^
=====
let x = [k for in 0..3]
-----
t:1:16: error: `in` can't stand here
   1 | let x = [k for in 0..3]
     |                ^^ here belongs a name
=====
let x = [k for k 0..3]
-----
t:1:18: error: a `,` is missing before `0`
   1 | let x = [k for k 0..3]
     |                  ^
=====
let x = 24 deg
-----
t:1:12: error: a unit stands right behind its number
   1 | let x = 24 deg
     |            ^^^ write 24deg
=====
sphere(24 mm)
-----
t:1:11: error: a unit stands right behind its number
   1 | sphere(24 mm)
     |           ^^ write 24mm
=====
let x = .5
-----
t:1:9: error: a number begins with a digit
   1 | let x = .5
     |         ^ write 0.5
=====
let x = 1.
-----
t:1:10: error: a digit is missing after the point
   1 | let x = 1.
     |          ^ write 1.0 or 1
=====
let x = #12345
-----
t:1:9: error: the colour `#12345` has 5 digits
   1 | let x = #12345
     |         ^^^^^^ a colour is #rgb or #rrggbb
=====
let x = #12345g
-----
t:1:9: error: the colour `#12345g` has a letter that is no hexadecimal digit
   1 | let x = #12345g
     |         ^^^^^^^ a colour is #rgb or #rrggbb
=====
# a comment
-----
t:1:1: error: `#` begins no comment
   1 | # a comment
     | ^ write `//`
=====
/* a comment */ box()
-----
t:1:1: error: `/* … */` is no comment here
   1 | /* a comment */ box()
     | ^^ begin each line of a comment with `//`
=====
box() /* a
comment */
-----
t:1:7: error: `/* … */` is no comment here
   1 | box() /* a
     |       ^^ begin each line of a comment with `//`
=====
sphere "a"
-----
t:1:8: error: arguments are written in parentheses
   1 | sphere "a"
     |        ^^^ write sphere("a")
=====
sphere 1
-----
t:1:8: error: arguments are written in parentheses
   1 | sphere 1
     |        ^ write sphere(1)
=====
sphere radius: 1
-----
t:1:8: error: arguments are written in parentheses
   1 | sphere radius: 1
     |        ^^^^^^ write sphere(radius: …)
=====
x = 3
-----
t:1:1: error: a name is bound with `let`
   1 | x = 3
     | ^ write let x = …
=====
x: 3
-----
t:1:2: error: a name is bound with `let` and `=`
   1 | x: 3
     |  ^ write let x = …; arguments stand inside ( )
=====
f(x) = 3
-----
t:1:6: error: only `let` and `param` bind with `=`
   1 | f(x) = 3
     |      ^ write let name(…) = …
=====
sphere(radius = 1)
-----
t:1:15: error: arguments are written with `:`, not `=`
   1 | sphere(radius = 1)
     |               ^ write radius: …
=====
sphere(1: 2)
-----
t:1:9: error: only a name stands before `:`
   1 | sphere(1: 2)
     |         ^ write name: value
=====
sphere(1) box()
-----
t:1:11: error: an operator or the end of the line is missing before `box`
   1 | sphere(1) box()
     |           ^^^ write each item on a line of its own
=====
group()
{ box() }
-----
t:2:1: error: this `{` has no line to belong to
   2 | { box() }
     | ^ write it at the end of the line above
=====
group() { box()
-----
t:1:9: error: this `{` is not closed
   1 | group() { box()
     |         ^ write `}` after its last item
=====
group() {
  box()
}
}
-----
t:4:1: error: nothing is open that this `}` could close
   4 | }
     | ^ delete it
=====
group() {
  sphere(1 1)
  box(
}
torus(1 1)
-----
t:2:12: error: a `,` is missing before `1`
   2 |   sphere(1 1)
     |            ^
t:3:6: error: this `(` is not closed
   3 |   box(
     |      ^ write `)` where it ends
t:5:9: error: a `,` is missing before `1`
   5 | torus(1 1)
     |         ^
=====
{ box() }
-----
t:1:1: error: this `{` has nothing to belong to
   1 | { box() }
     | ^ write group() { … }
=====
let x = 'abc'
-----
t:1:9: error: the language has no `'`
   1 | let x = 'abc'
     |         ^ strings are written in double quotes: "…"
=====
let x = "abc
-----
t:1:9: error: this string is not closed
   1 | let x = "abc
     |         ^^^^ write `"` at its end
=====
let x = "C:\models"
-----
t:1:12: error: a string has no `\m`
   1 | let x = "C:\models"
     |            ^^ write `/` in paths; a backslash is `\\`, a line end `\n`
=====
+ 3
-----
t:1:1: error: a line can't begin with `+`
   1 | + 3
     | ^ end the line above with the `+`
=====
let x = 3
  + 4
-----
t:2:3: error: a line can't begin with `+`
   2 |   + 4
     |   ^ end the line above with the `+`
=====
let x = a.
-----
t:1:10: error: something is missing after `.`
   1 | let x = a.
     |          ^ here belongs a name
=====
let x = a.for
-----
t:1:11: error: `for` is a word of the language and can't be a name
   1 | let x = a.for
     |           ^^^ choose another name
=====
let x = a[]
-----
t:1:10: error: a value is missing after `[`
   1 | let x = a[]
     |          ^
=====
let x = a[1, 2]
-----
t:1:12: error: an index is one number
   1 | let x = a[1, 2]
     |            ^ write list[i][j]
=====
let x = ()
-----
t:1:9: error: a value is missing after `(`
   1 | let x = ()
     |         ^
=====
let x = |a|
-----
t:1:11: error: a value is missing after `|`
   1 | let x = |a|
     |           ^
=====
let x = |a b| a
-----
t:1:12: error: a `,` or the closing `|` is missing before `b`
   1 | let x = |a b| a
     |            ^ a function is written |x, y| x + y
=====
let x = |a, b a
-----
t:1:15: error: a `,` or the closing `|` is missing before `a`
   1 | let x = |a, b a
     |               ^ a function is written |x, y| x + y
=====
let x = a = b
-----
t:1:11: error: `=` binds a name; values are compared with `==`
   1 | let x = a = b
     |           ^ write `==`
=====
sphere(1; 2)
-----
t:1:9: error: `;` ends an item, but a bracket is still open
   1 | sphere(1; 2)
     |         ^^ write `,`
=====
let x = 1 let y = 2
-----
t:1:11: error: `let` begins an item
   1 | let x = 1 let y = 2
     |           ^^^ write it on a line of its own
=====
sphere(let x = 3)
-----
t:1:8: error: `let` can't stand inside brackets
   1 | sphere(let x = 3)
     |        ^^^ write it on a line of its own
=====
f(x for x in y)
-----
t:1:5: error: a `for` inside a value stands in a list
   1 | f(x for x in y)
     |     ^^^ write [f(k) for k in 0..5]
=====
import "a"
-----
t:1:1: error: the language has no `import`
   1 | import "a"
     | ^^^^^^ write use "gear.scene"
=====
def f(x): return x
-----
t:1:1: error: the language has no `def`
   1 | def f(x): return x
     | ^^^ write let name(…) = …
=====
let x = a ? b : c
-----
t:1:11: error: the language has no `?`
   1 | let x = a ? b : c
     |           ^ write `if … then … else …`
=====
let x = @a
-----
t:1:9: error: the language has no `@`
   1 | let x = @a
     |         ^
=====
let x = “abc”
-----
t:1:9: error: the language has no `“`
   1 | let x = “abc”
     |         ^ strings are written in straight quotes: "…"
=====
sphere(radius: 1, center: [0, 1, 0]
  material: red)
-----
t:2:3: error: a `,` is missing before `material`
   2 |   material: red)
     |   ^^^^^^^^
=====
group(translate: [1, 0, 0] {
  sphere(1)
}
box(1)
-----
t:1:6: error: this `(` is not closed
   1 | group(translate: [1, 0, 0] {
     |      ^ write `)` where it ends
=====
group() {
  transform() {
    sphere(1)
  box()
}
torus()
-----
t:2:15: error: this `{` is not closed
   2 |   transform() {
     |               ^ write `}` after its last item
=====
1 + 2
-----
t:1:3: error: this line is a value, and only elements can be placed
   1 | 1 + 2
     |   ^ write let name = … to keep it
=====
sphere(radius: )
-----
t:1:14: error: a value is missing after `:`
   1 | sphere(radius: )
     |              ^
=====
sphere(radius:: 2)
-----
t:1:15: error: only a name stands before `:`
   1 | sphere(radius:: 2)
     |               ^ write name: value
=====
let x == 3
-----
t:1:7: error: `let` takes `=`, not `==`
   1 | let x == 3
     |       ^^ write let x = …
=====
camera(position: [0, 0, 5] look_at: [0, 0, 0])
-----
t:1:28: error: a `,` is missing before `look_at`
   1 | camera(position: [0, 0, 5] look_at: [0, 0, 0])
     |                            ^^^^^^^
=====
let f = (x) => x + 1
-----
t:1:13: error: the language has no `=>`
   1 | let f = (x) => x + 1
     |             ^ write `>=`; a function is written |x| x + 1
=====
let f = x -> x + 1
-----
t:1:11: error: the language has no `->`
   1 | let f = x -> x + 1
     |           ^ a function is written |x| x + 1
=====
let s = "a" "b"
-----
t:1:13: error: an operator or the end of the line is missing before `"b"`
   1 | let s = "a" "b"
     |             ^^^ write each item on a line of its own
=====
let a = not
-----
t:1:9: error: a value is missing after `not`
   1 | let a = not
     |         ^^^
=====
let x = - -
-----
t:1:11: error: a value is missing after `-`
   1 | let x = - -
     |           ^
=====
return 3
-----
t:1:1: error: the language has no `return`
   1 | return 3
     | ^^^^^^ what stands behind the `=` of a `let` is its value
=====
sphere(radius: if a then b)
-----
t:1:21: error: this `if` has no `else`
   1 | sphere(radius: if a then b)
     |                     ^^^^ write if … then … else …
=====
for (k in 0..3 { box() }
-----
t:1:5: error: this `(` is not closed
   1 | for (k in 0..3 { box() }
     |     ^ write `)` where it ends
=====
material red { }
-----
t:1:10: error: arguments are written in parentheses
   1 | material red { }
     |          ^^^ write material(red)
=====
let x = 5m m
-----
t:1:12: error: an operator or the end of the line is missing before `m`
   1 | let x = 5m m
     |            ^ write each item on a line of its own
=====
let x = -
-----
t:1:9: error: a value is missing after `-`
   1 | let x = -
     |         ^
=====
transform(translate: [1 , 2 3]) { box() }
-----
t:1:29: error: a `,` is missing before `3`
   1 | transform(translate: [1 , 2 3]) { box() }
     |                             ^
=====
let x = 3 in 0..5
-----
t:1:11: error: only a `param` has a range
   1 | let x = 3 in 0..5
     |           ^^ write param x = …
=====
param x = 3 : "doc"
-----
t:1:13: error: a `param` takes its value with `=`
   1 | param x = 3 : "doc"
     |             ^ write param x = …
=====
let m = lambert(#c9c4bb
let n = 3
-----
t:1:16: error: this `(` is not closed
   1 | let m = lambert(#c9c4bb
     |                ^ write `)` where it ends
=====
box(size: [1, 2, 3)
-----
t:1:11: error: this `[` is not closed
   1 | box(size: [1, 2, 3)
     |           ^ write `]` before the `)`
=====
box(size: (1 + 2)
-----
t:1:4: error: this `(` is not closed
   1 | box(size: (1 + 2)
     |    ^ write `)` where it ends
=====
sphere(1) }
-----
t:1:11: error: nothing is open that this `}` could close
   1 | sphere(1) }
     |           ^ delete it
=====
let 3x = 3
-----
t:1:5: error: a name begins with a letter, not as `3x`
   1 | let 3x = 3
     |     ^^
=====
let my-name = 3
-----
t:1:7: error: a name has no `-`
   1 | let my-name = 3
     |       ^ write my_name
=====
let x := 3
-----
t:1:7: error: the language has no `:=`
   1 | let x := 3
     |       ^ write `=` after let and param, `:` in arguments
=====
x += 3
-----
t:1:3: error: the language has no `+=`
   1 | x += 3
     |   ^ names are bound once, with `let`
=====
let f(x) { box() }
-----
t:1:10: error: `=` is missing before the value of `f`
   1 | let f(x) { box() }
     |          ^ write let f(…) = …
=====
let x = {a: 1}
-----
t:1:9: error: a value can't begin with `{`
   1 | let x = {a: 1}
     |         ^ a list is written [a, b], a part group() { … }
=====
let x = [1, 2, ...]
-----
t:1:16: error: the language has no `...`
   1 | let x = [1, 2, ...]
     |                ^^ write `..` for a range
=====
not a
-----
t:1:1: error: a line can't begin with `not`
   1 | not a
     | ^^^
=====
let g = difference(a, b) c
-----
t:1:26: error: an operator or the end of the line is missing before `c`
   1 | let g = difference(a, b) c
     |                          ^ write each item on a line of its own
=====
// All errors of a file at once, in order; what stands between them is read.
use room
let a: 3
group() {
  sphere(radius = 1)
  box(size: 24 mm)
  torus(1, 0.2)
  for k in 0..3 { cone(1 2) }
}
let b = (1 + 2
let c = "open
if (a > b) { sphere(1 } else { box(,) }
sphere(#12)
-----
t:2:5: error: the file after `use` is written in quotes
   2 | use room
     |     ^^^^ write use "std/room" or use "room.scene"
t:3:6: error: `let` takes `=`, not `:`
   3 | let a: 3
     |      ^ write let a = …
t:5:17: error: arguments are written with `:`, not `=`
   5 |   sphere(radius = 1)
     |                 ^ write radius: …
t:6:16: error: a unit stands right behind its number
   6 |   box(size: 24 mm)
     |                ^^ write 24mm
t:8:7: error: `for` wants its name and list in parentheses
   8 |   for k in 0..3 { cone(1 2) }
     |       ^ write for (k in 0..5) { … }
t:8:26: error: a `,` is missing before `2`
   8 |   for k in 0..3 { cone(1 2) }
     |                          ^
t:10:9: error: this `(` is not closed
  10 | let b = (1 + 2
     |         ^ write `)` where it ends
t:11:9: error: this string is not closed
  11 | let c = "open
     |         ^^^^^ write `"` at its end
t:12:20: error: this `(` is not closed
  12 | if (a > b) { sphere(1 } else { box(,) }
     |                    ^ write `)` where it ends
t:12:35: error: a value is missing after `(`
  12 | if (a > b) { sphere(1 } else { box(,) }
     |                                   ^
t:13:8: error: the colour `#12` has 2 digits
  13 | sphere(#12)
     |        ^^^ a colour is #rgb or #rrggbb
=====
let name = "maquette
sphere(1)
-----
t:1:12: error: this string is not closed
   1 | let name = "maquette
     |            ^^^^^^^^^ write `"` at its end
=====
mesh("bunny.obj, height: 35cm)
-----
t:1:6: error: this string is not closed
   1 | mesh("bunny.obj, height: 35cm)
     |      ^^^^^^^^^^^^^^^^^^^^^^^^^ write `"` at its end
=====
box() # two boxes
-----
t:1:7: error: `#` begins no comment
   1 | box() # two boxes
     |       ^ write `//`
=====
#TODO more boxes (and rounder ones
-----
t:1:1: error: `#` begins no comment
   1 | #TODO more boxes (and rounder ones
     | ^ write `//`
=====
let c = #1234567
-----
t:1:9: error: the colour `#1234567` has 7 digits
   1 | let c = #1234567
     |         ^^^^^^^^ a colour is #rgb or #rrggbb
=====
sphere(1)
  translate: [1, 0, 0]
-----
t:2:12: error: a name is bound with `let` and `=`
   2 |   translate: [1, 0, 0]
     |            ^ write let translate = …; arguments stand inside ( )
=====
group() {
-----
t:1:9: error: this `{` is not closed
   1 | group() {
     |         ^ write `}` after its last item
=====
let a = [[1, 2], [3, 4]
let b = 2
-----
t:1:9: error: this `[` is not closed
   1 | let a = [[1, 2], [3, 4]
     |         ^ write `]` where it ends
=====
let gear(n) = difference() {
  cylinder(radius: n, height: 2
  for (k in 0..5) { cylinder(radius: 1) }
}
gear(4)
-----
t:2:11: error: this `(` is not closed
   2 |   cylinder(radius: n, height: 2
     |           ^ write `)` where it ends
=====
param radius = 1 in 0.2..2 "sphere radius
-----
t:1:28: error: this string is not closed
   1 | param radius = 1 in 0.2..2 "sphere radius
     |                            ^^^^^^^^^^^^^^ write `"` at its end
=====
sphere(radius: if big then 2 else)
-----
t:1:30: error: a value is missing after `else`
   1 | sphere(radius: if big then 2 else)
     |                              ^^^^
=====
if (a) { box() } else if { sphere() }
-----
t:1:26: error: `if` wants its condition in parentheses
   1 | if (a) { box() } else if { sphere() }
     |                          ^ write else if (…) { … }
=====
sphere(radius: 1 center: [0, 1, 0])
-----
t:1:18: error: a `,` is missing before `center`
   1 | sphere(radius: 1 center: [0, 1, 0])
     |                  ^^^^^^
=====
let x = a = 3
-----
t:1:11: error: `=` binds a name; values are compared with `==`
   1 | let x = a = 3
     |           ^ write `==`
=====
let f(x, y) = x + y let z = 2
-----
t:1:21: error: `let` begins an item
   1 | let f(x, y) = x + y let z = 2
     |                     ^^^ write it on a line of its own
'''


def messages(source: str) -> str:
    """Every message of `source`, printed."""
    diagnostics = Diagnostics()
    parse.parse(source, "t", diagnostics)
    return "\n".join(render_text(d, lambda _: source) for d in diagnostics.items)


@pytest.mark.parametrize("case", CASES.strip("\n").split("\n=====\n"))
def test_message(case):
    source, _, expected = case.partition("\n-----\n")
    printed = "\n".join(line.rstrip() for line in messages(source).splitlines())
    assert printed == expected
