"""Things of a household: sizes, masses and materials of about 250 products.

A row has a name, a kind, the three sides of the smallest box in falling order [mm], the standard deviation of
their logarithms, the 5 % and the 95 % quantile of the mass [g], a key of the material table (empty: none of it), by
which friction and restitution are known, and a source: `ycb` (sizes and masses as published with the YCB object set,
Calli et al. 2015, widened to products of the same kind) or `shop` (estimates for common products, not measured). A
thing whose colour belongs to what it is has the words of its colours in an eleventh column.
"""

from __future__ import annotations

ROWS = """
chips can,cylinder,250,75,75,0.05,150,240,cardboard,ycb
coffee can,cylinder,139,102,102,0.05,400,1000,metal,ycb
cracker box,box,230,160,60,0.05,340,480,cardboard,ycb
sugar box,box,175,89,38,0.05,450,580,cardboard,ycb
soup can,cylinder,101,66,66,0.05,300,400,metal,ycb
mustard bottle,bottle,190,95,58,0.05,500,700,plastic,ycb
tuna can,cylinder,85,85,33,0.05,140,205,metal,ycb
pudding box,box,110,89,35,0.05,155,220,cardboard,ycb
gelatin box,box,85,73,28,0.05,80,116,cardboard,ycb
potted meat can,box,97,82,50,0.05,310,430,metal,ycb
banana,object,190,45,36,0.12,60,180,food,ycb,yellow|green|brown
strawberry,object,55,44,44,0.15,12,35,food,ycb,red|pink
apple,ball,75,75,75,0.12,65,240,food,ycb,red|green|yellow|pink
lemon,ball,68,54,54,0.12,28,150,food,ycb,yellow
peach,ball,59,59,59,0.15,32,180,food,ycb,orange|pink|red|yellow
pear,object,100,66,66,0.12,48,220,food,ycb,green|yellow
orange,ball,73,73,73,0.10,46,220,food,ycb,orange
plum,ball,52,52,52,0.15,24,90,food,ycb,purple|red|black
pitcher,mug,235,145,108,0.06,150,900,plastic,ycb
bleach bottle,bottle,250,98,65,0.05,900,1300,plastic,ycb
glass cleaner bottle,bottle,270,105,80,0.06,850,1200,plastic,ycb
metal bowl,bowl,159,159,53,0.08,120,250,metal,ycb,gray|white
metal mug,mug,117,93,82,0.06,95,150,metal,ycb,gray|white
sponge,box,114,72,14,0.10,4,12,fabric,ycb
skillet,object,455,270,60,0.08,700,1400,metal,ycb,black|gray
dinner plate,bowl,258,258,24,0.06,240,650,ceramic,ycb
fork,object,198,20,14,0.10,25,55,metal,ycb,gray|white
spoon,object,195,20,14,0.10,22,55,metal,ycb,gray|white
table knife,object,215,20,14,0.10,25,80,metal,ycb,gray|white
spatula,object,350,83,35,0.10,40,90,plastic,ycb
cordless drill,object,187,184,46,0.08,800,1500,plastic,ycb
wood block,box,206,90,90,0.05,550,900,wood,ycb,brown|orange|yellow
scissors,object,200,87,14,0.10,50,120,metal,ycb
padlock,object,65,47,27,0.12,150,340,metal,ycb
large marker,cylinder,121,18,18,0.08,12,22,plastic,ycb
adjustable wrench,object,205,55,15,0.10,180,330,metal,ycb
screwdriver,object,215,31,31,0.12,60,130,plastic,ycb
hammer,object,330,135,32,0.08,500,800,wood,ycb
small clamp,object,85,65,27,0.10,15,35,plastic,ycb
medium clamp,object,120,90,27,0.10,45,80,plastic,ycb
large clamp,object,202,125,36,0.10,110,240,plastic,ycb
mini soccer ball,ball,140,140,140,0.05,90,160,rubber,ycb
softball,ball,96,96,96,0.05,165,220,rubber,ycb,yellow|green|white
baseball,ball,75,75,75,0.05,130,165,rubber,ycb,white
tennis ball,ball,65,65,65,0.04,54,62,rubber,ycb,yellow|green
racquetball,ball,55,55,55,0.04,38,46,rubber,ycb
golf ball,ball,43,43,43,0.04,43,49,rubber,ycb,white
foam brick,box,77,52,50,0.06,15,45,fabric,ycb
die,box,16,16,16,0.10,3,7,plastic,ycb
stacking cup large,mug,95,95,73,0.10,24,45,plastic,ycb
stacking cup small,mug,60,60,55,0.12,10,22,plastic,ycb
toy airplane,object,270,190,170,0.15,300,700,plastic,ycb
timer,box,85,80,40,0.15,80,160,plastic,ycb
puzzle cube,box,57,57,57,0.05,75,115,plastic,ycb
cereal box,box,300,195,65,0.10,300,700,cardboard,shop
small cereal box,box,220,150,50,0.12,200,450,cardboard,shop
pasta box,box,200,110,45,0.15,350,700,cardboard,shop
spaghetti box,box,270,75,40,0.12,420,600,cardboard,shop
rice box,box,190,110,50,0.12,450,1100,cardboard,shop
baking mix box,box,190,135,45,0.10,350,600,cardboard,shop
flour bag,box,180,110,70,0.08,950,1150,paper,shop
sugar bag,box,160,100,65,0.08,950,1150,paper,shop
salt box,box,145,90,55,0.10,480,800,cardboard,shop
tea box,box,130,75,70,0.15,50,180,cardboard,shop
flat tea box,box,150,125,70,0.15,80,220,cardboard,shop
biscuit box,box,210,140,50,0.15,180,450,cardboard,shop
chocolate bar,box,160,78,10,0.12,90,210,food,shop
chocolate box,box,200,180,30,0.20,150,400,cardboard,shop
granola bar box,box,165,130,45,0.12,140,280,cardboard,shop
tissue box,box,235,115,80,0.12,150,350,cardboard,shop
tissue cube,box,125,115,115,0.08,150,260,cardboard,shop
medicine box,box,120,60,25,0.25,20,90,cardboard,shop
toothpaste box,box,190,45,38,0.10,80,170,cardboard,shop
soap box,box,95,62,35,0.12,90,150,cardboard,shop
soap bar,object,90,60,30,0.15,70,150,plastic,shop
detergent box,box,250,170,80,0.12,900,2200,cardboard,shop
light bulb box,box,120,65,65,0.12,50,140,cardboard,shop
playing cards,box,92,65,20,0.08,85,115,paper,shop
board game,box,295,295,70,0.15,700,2200,cardboard,shop
small parcel,box,200,140,60,0.25,120,900,cardboard,shop,brown|orange
parcel,box,300,220,120,0.25,300,3000,cardboard,shop,brown|orange
shoe box,box,330,200,120,0.10,300,1300,cardboard,shop
egg carton,box,250,105,70,0.15,250,720,cardboard,shop,gray|brown
milk carton,box,240,75,75,0.10,900,1150,cardboard,shop
juice carton,box,195,92,62,0.10,950,1150,cardboard,shop
drink carton,box,120,63,40,0.10,190,290,cardboard,shop
butter,box,120,70,38,0.12,220,300,food,shop
cheese block,box,130,75,40,0.15,200,500,food,shop
paperback,box,190,120,22,0.18,150,420,paper,shop
hardcover book,box,235,160,32,0.18,400,1100,paper,shop
textbook,box,275,215,35,0.15,900,2200,paper,shop
magazine,box,290,215,5,0.15,100,350,paper,shop
notebook of paper,box,210,148,12,0.20,120,400,paper,shop
sticky notes,box,76,76,12,0.15,30,65,paper,shop
drinks can,cylinder,122,66,66,0.04,340,400,metal,shop
slim drinks can,cylinder,145,57,57,0.06,260,365,metal,shop
small drinks can,cylinder,134,53,53,0.05,255,290,metal,shop
large food can,cylinder,115,99,99,0.06,750,1000,metal,shop
food can,cylinder,110,75,75,0.06,400,500,metal,shop
small food can,cylinder,75,68,68,0.10,180,300,metal,shop
fish tin,box,105,60,24,0.10,110,170,metal,shop
paint can,cylinder,130,108,108,0.08,800,1500,metal,shop
spray can,cylinder,200,55,55,0.10,200,450,metal,shop
biscuit tin,cylinder,185,185,70,0.10,450,1000,metal,shop
cocoa tin,cylinder,150,80,80,0.12,250,500,cardboard,shop
salt shaker,cylinder,90,45,45,0.15,60,250,glass,shop
spice jar,cylinder,105,45,45,0.12,80,200,glass,shop
jam jar,cylinder,110,75,75,0.12,350,650,glass,shop
pickle jar,cylinder,150,85,85,0.12,500,1100,glass,shop
peanut butter jar,cylinder,125,80,80,0.12,300,600,plastic,shop
yoghurt cup,cylinder,95,75,75,0.15,110,280,plastic,shop
cream jar,cylinder,60,60,45,0.20,50,160,plastic,shop
vitamin bottle,bottle,110,60,60,0.15,60,220,plastic,shop
pill bottle,bottle,80,40,40,0.15,20,80,plastic,shop
candle,cylinder,100,70,70,0.25,150,450,,shop
toilet paper roll,cylinder,110,110,100,0.10,70,170,paper,shop,white
kitchen roll,cylinder,230,115,115,0.10,120,320,paper,shop,white
adhesive tape roll,cylinder,110,110,48,0.15,80,300,plastic,shop
battery pack,box,110,85,18,0.20,40,200,plastic,shop
battery,cylinder,50,14,14,0.10,20,26,metal,shop
water bottle half litre,bottle,215,65,65,0.08,20,540,plastic,shop
water bottle large,bottle,310,90,90,0.08,35,1560,plastic,shop
soda bottle half litre,bottle,230,66,66,0.06,25,560,plastic,shop
wine bottle,bottle,300,76,76,0.05,450,1350,glass,shop
beer bottle,bottle,235,62,62,0.08,190,620,glass,shop
ketchup bottle,bottle,200,85,55,0.12,300,700,plastic,shop
dressing bottle,bottle,210,70,60,0.12,250,650,glass,shop
oil bottle,bottle,270,75,75,0.10,500,1150,plastic,shop
vinegar bottle,bottle,270,70,70,0.10,550,1100,glass,shop
soy sauce bottle,bottle,170,60,60,0.12,200,450,glass,shop
syrup bottle,bottle,190,80,60,0.12,350,750,plastic,shop
shampoo bottle,bottle,200,75,50,0.15,220,500,plastic,shop
hand soap pump,bottle,190,80,60,0.12,250,500,plastic,shop
dish soap,bottle,235,80,45,0.12,350,750,plastic,shop
lotion bottle,bottle,180,65,45,0.15,200,450,plastic,shop
detergent bottle,bottle,270,180,90,0.12,900,2500,plastic,shop
spray bottle,bottle,260,100,75,0.12,80,850,plastic,shop
baby bottle,bottle,180,65,65,0.12,60,350,plastic,shop
thermos,bottle,260,75,75,0.10,280,800,metal,shop
sports bottle,bottle,230,75,75,0.12,80,850,plastic,shop
cocktail shaker,bottle,220,90,90,0.10,250,500,metal,shop
coconut water carton,box,170,62,50,0.12,330,400,cardboard,shop
coffee mug,mug,118,95,83,0.10,270,420,ceramic,shop
large mug,mug,135,110,95,0.12,330,550,ceramic,shop
espresso cup,mug,85,65,60,0.15,90,180,ceramic,shop
tea cup,mug,115,95,60,0.12,120,260,ceramic,shop
paper cup,mug,110,85,85,0.12,8,30,paper,shop,white|brown
plastic cup,mug,120,85,85,0.15,10,90,plastic,shop
drinking glass,mug,130,75,75,0.15,180,400,glass,shop
wine glass,object,210,80,80,0.12,110,220,glass,shop
thermal mug,mug,180,85,80,0.12,200,450,metal,shop
beer mug,mug,150,130,90,0.12,450,900,glass,shop
flower pot,mug,130,130,120,0.25,150,1500,ceramic,shop
cereal bowl,bowl,160,160,65,0.10,280,550,ceramic,shop
small bowl,bowl,115,115,50,0.12,130,320,ceramic,shop
salad bowl,bowl,230,230,85,0.12,450,1300,ceramic,shop
plastic bowl,bowl,170,170,70,0.20,60,200,plastic,shop
mixing bowl,bowl,240,240,120,0.12,250,800,metal,shop,gray|white
soup plate,bowl,225,225,45,0.08,350,650,ceramic,shop
side plate,bowl,190,190,20,0.10,180,420,ceramic,shop
plastic plate,bowl,235,235,22,0.12,20,180,plastic,shop
saucer,bowl,150,150,20,0.10,120,260,ceramic,shop
tray,box,420,300,30,0.20,300,1300,plastic,shop
wicker basket,bowl,280,200,110,0.25,120,600,,shop,brown|orange|yellow
plastic basket,bowl,300,220,130,0.25,150,600,plastic,shop
food container,box,190,130,70,0.20,80,1100,plastic,shop
lunch box,box,210,150,60,0.20,120,900,plastic,shop
sauce pan,object,340,180,110,0.15,500,1500,metal,shop,gray|black
cooking pot,object,300,230,140,0.15,900,2500,metal,shop,gray|black
cutting board,box,350,240,15,0.18,400,1800,wood,shop,brown|orange|yellow|white
rolling pin,cylinder,400,55,55,0.15,250,700,wood,shop,brown|orange|yellow
whisk,object,270,65,65,0.15,50,140,metal,shop,gray
ladle,object,300,90,70,0.15,60,160,metal,shop,gray|black
peeler,object,170,60,20,0.18,30,90,metal,shop
grater,object,230,110,80,0.15,150,400,metal,shop,gray
can opener,object,175,55,50,0.12,100,280,metal,shop
corkscrew,object,150,70,30,0.18,80,250,metal,shop
egg,ball,58,44,44,0.06,50,70,food,shop,white|brown|orange|pink
tomato,ball,68,68,60,0.15,80,200,food,shop,red|orange
potato,object,100,65,60,0.20,100,320,food,shop,brown|yellow|orange
onion,ball,75,75,70,0.15,90,250,food,shop,brown|orange|white|purple
carrot,object,180,30,30,0.20,50,140,food,shop,orange
cucumber,object,270,45,45,0.18,200,500,food,shop,green
bell pepper,object,95,80,80,0.15,120,260,food,shop,red|green|yellow|orange
avocado,object,105,72,72,0.12,150,300,food,shop,green|black|brown
lime,ball,55,48,48,0.12,50,100,food,shop,green
kiwi,ball,68,52,52,0.10,70,120,food,shop,brown|green
mango,object,115,80,75,0.15,200,450,food,shop,green|yellow|orange|red
pineapple,object,280,120,120,0.15,900,2000,food,shop,brown|orange|yellow|green
bread loaf,object,270,120,110,0.18,400,900,food,shop,brown|orange
bagel,object,110,110,40,0.12,80,130,food,shop,brown|orange
croissant,object,150,80,60,0.18,45,95,food,shop,brown|orange
laptop 13 inch,laptop,310,215,16,0.06,1100,1600,electronics,shop,gray|black|white
laptop 15 inch,laptop,355,245,19,0.06,1500,2300,electronics,shop,gray|black|white
tablet,box,250,170,8,0.10,350,700,electronics,shop
smartphone,box,150,72,8,0.07,140,235,electronics,shop
remote control,box,180,45,22,0.18,60,160,plastic,shop
computer mouse,object,115,62,38,0.10,60,140,plastic,shop
keyboard,box,440,140,25,0.15,350,1100,plastic,shop
game controller,object,155,105,60,0.08,200,300,plastic,shop
headphones,object,190,170,80,0.12,150,380,plastic,shop
camera,object,130,95,75,0.18,350,1000,electronics,shop
webcam,object,95,60,50,0.25,70,200,electronics,shop
external drive,box,115,80,15,0.15,100,260,electronics,shop
power adapter,box,95,60,30,0.25,80,350,electronics,shop
power bank,box,150,70,20,0.20,150,450,electronics,shop
calculator,box,150,78,15,0.15,70,180,plastic,shop
alarm clock,box,100,90,60,0.25,100,450,plastic,shop
flashlight,cylinder,160,38,38,0.25,80,350,metal,shop
speaker,cylinder,180,75,75,0.25,300,900,electronics,shop
stapler,object,145,60,38,0.15,120,350,metal,shop
tape dispenser,object,150,75,60,0.18,100,900,plastic,shop
glue stick,cylinder,100,28,28,0.15,20,50,plastic,shop
pen,object,145,12,12,0.10,6,25,plastic,shop
pencil case,object,210,80,50,0.20,60,350,fabric,shop
ruler,box,310,35,3,0.15,20,90,plastic,shop
glasses,object,145,140,42,0.10,18,50,plastic,shop
sunglasses,object,145,145,45,0.10,20,50,plastic,shop
glasses case,box,165,65,45,0.12,60,180,plastic,shop
wallet,box,115,90,22,0.18,80,230,fabric,shop
key ring,object,90,45,20,0.25,30,150,metal,shop
watch,object,100,60,45,0.25,40,170,metal,shop
umbrella,object,280,55,55,0.15,250,480,fabric,shop
shoe,object,290,115,110,0.12,200,500,rubber,shop
cap,object,270,180,130,0.15,60,130,fabric,shop
folded shirt,box,300,230,30,0.20,130,350,fabric,shop
towel,box,320,240,60,0.25,200,700,fabric,shop
plush toy,object,250,170,130,0.30,80,450,fabric,shop
toy car,object,75,32,25,0.20,30,80,metal,shop
toy bus,object,170,70,60,0.25,90,350,plastic,shop
toy truck,object,250,110,120,0.25,250,900,plastic,shop
toy brick large,box,64,32,24,0.15,8,20,plastic,shop
wooden cube,box,45,45,45,0.25,25,120,wood,shop,brown|orange|yellow
rubber duck,object,90,80,75,0.25,30,90,rubber,shop,yellow
hand brush,object,270,70,50,0.18,90,260,plastic,shop
hair brush,object,230,65,40,0.15,60,150,plastic,shop
toothbrush,object,190,18,15,0.10,12,25,plastic,shop
razor,object,145,42,28,0.15,15,60,plastic,shop
thermometer,object,130,22,14,0.20,8,40,plastic,shop
pliers,object,185,55,20,0.15,130,320,metal,shop,gray|red|blue
tape measure,object,75,70,38,0.15,120,350,metal,shop
utility knife,object,165,38,22,0.15,50,180,metal,shop
spirit level,box,400,55,22,0.25,200,600,metal,shop
hot glue gun,object,190,150,40,0.15,180,400,plastic,shop
heat gun,object,255,200,85,0.12,550,900,plastic,shop
dustpan,object,310,220,60,0.15,150,350,plastic,shop
brick,box,240,115,71,0.06,2300,3600,,shop,red|brown|orange
stone,object,110,80,60,0.35,400,1600,,shop,gray|brown|black|white
"""
